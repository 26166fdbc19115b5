"""An arm and a gripper from plain settings, as conf/pick.yaml has them, for as long as a block of code runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from pecgrasp_env.motion.trajectory import JOINT_SPEED
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.robotiq import RobotiqGripper
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.real.ur_models import URModel
from pecgrasp_env.real.workspace import Workspace
from pecgrasp_env.robot.camera_mount import BRACKET, CameraMount, read_any_mount

CONFIRM = ("each", "once", "no")


class SettingError(RobotError, ValueError):
    """A setting makes no sense; the message names it."""


@contextmanager
def connected(settings: Mapping[str, Any], speed: float = JOINT_SPEED) -> Iterator[tuple[URArm, RobotiqGripper]]:
    """settings: robot, host, payload, payload_centre, patience. speed: rad/s, the most of a joint. Raises SettingError
    and what `URArm` raises.
    """
    model = URModel.from_mapping(settings["robot"])
    payload = (float(settings["payload"]), tuple(settings["payload_centre"]))
    arm = URArm(settings["host"], model, speed=speed, payload=payload, patience=settings["patience"])
    try:
        gripper = RobotiqGripper(settings["host"])
        try:
            yield arm, gripper
        finally:
            gripper.close()
    finally:
        arm.close()


def workspace_of(settings: Mapping[str, Any]) -> Workspace:
    """Of its fields."""
    return Workspace(tuple(settings["low"]), tuple(settings["high"]), settings["table"], settings["max_force"])


def mount_of_setting(calibration: str | None) -> CameraMount:
    """Of a file that `pecgrasp calibrate` has left; None: this project's bracket. Raises MountError."""
    return BRACKET if calibration is None else read_any_mount(calibration)


class Agreement:
    """Asks before each motion, or before the first. Raises SettingError for another answer to when."""

    def __init__(self, confirm: str, ask: Callable[[str], bool]) -> None:
        if confirm not in CONFIRM:
            raise SettingError(f"confirm={confirm}: must be one of {', '.join(CONFIRM)}")
        self._confirm, self._ask = confirm, ask
        self._agreed = confirm == "no"

    def agrees(self, doing: str) -> bool:
        if self._confirm == "each" or not self._agreed:
            self._agreed = self._ask(doing)
        return self._agreed
