"""Where a Universal Robots arm's flange is now, while a person moves it: nothing is sent to the arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from pecgrasp_env.real.errors import ConnectionLost, library
from pecgrasp_env.real.ur_measured import lengths_of
from pecgrasp_env.real.ur_models import URModel
from pecgrasp_env.robot.kinematics import forward_kinematics


def ur_flange(host: str, model: URModel) -> Callable[[], np.ndarray]:
    """A function that gives T_base_tool0 (4, 4) now, from the joint angles and the arm's own lengths, as in a
    pick.

    Not the controller's own pose: that is of the tool centre point that is set there. Raises ConnectionLost where no
    controller answers, WrongArm.
    """
    interface: Any = library("rtde_receive", "ur")
    arm = lengths_of(host, model)
    try:
        receive = interface.RTDEReceiveInterface(host, -1.0, ["timestamp", "actual_q"])
    except RuntimeError as error:
        raise ConnectionLost(f"host={host}: {error}; is it on, and is this its address?") from error

    def flange() -> np.ndarray:
        if not receive.isConnected():
            raise ConnectionLost(f"host={host}: the controller says nothing any more")
        return forward_kinematics(np.array(receive.getActualQ()), arm)

    return flange
