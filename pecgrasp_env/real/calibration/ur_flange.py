"""Where a Universal Robots arm's flange is now, while a person moves it: nothing is sent to the arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pecgrasp_env.real.errors import ConnectionLost, library
from pecgrasp_env.real.ur_models import URModel


def ur_flange(host: str, model: URModel) -> Callable[[], np.ndarray]:
    """A function that gives T_base_tool0 (4, 4) now, from the joint angles, as `pecgrasp pick` has it.

    Not the controller's own pose: that is of the tool centre point that is set there. Raises ConnectionLost where no
    controller answers.
    """
    interface: Any = library("rtde_receive", "ur")
    try:
        receive = interface.RTDEReceiveInterface(host, -1.0, ["timestamp", "actual_q"])
    except RuntimeError as error:
        raise ConnectionLost(f"host={host}: {error}; is it on, and is this its address?") from error

    def flange() -> np.ndarray:
        if not receive.isConnected():
            raise ConnectionLost(f"host={host}: the controller says nothing any more")
        return model.forward_kinematics(np.array(receive.getActualQ()))

    return flange
