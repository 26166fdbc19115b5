"""What can go wrong on a real robot, one class a kind; each message says what happened and what to do."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


class RobotError(RuntimeError):
    """Anything that a robot, its gripper or its camera refuses or fails at. The arm does not move afterwards until
    `recover` is called.
    """


class ProtectiveStop(RobotError):
    """The controller has stopped the arm: it hit something, or a safety limit."""


class EmergencyStop(RobotError):
    """The emergency stop is pressed."""


class ConnectionLost(RobotError):
    """Nothing comes from the controller, the gripper or the camera any more, or it cannot be reached."""


class NotInRemoteControl(RobotError):
    """The controller takes no commands from outside: it is in local mode, switched off, or its program was stopped."""


class GripperFault(RobotError):
    """The gripper is not activated or reports a fault."""


class JointLimit(RobotError):
    """A commanded joint angle is outside of what the arm can do. Nothing was sent."""


class WrongArm(RobotError):
    """The arm is of another type than was said: nothing planned for that type is true of it."""


class SpeedLimit(RobotError):
    """A speed, acceleration or force outside of what the device can do was asked for. Nothing was sent."""


class MotionTimeout(RobotError):
    """A motion was not finished within the time that one wanted to wait. It goes on; cancel or wait again."""


class Declined(RobotError):
    """The user did not agree to the next motion."""


class MissingExtra(RobotError, ImportError):
    """A driver's library is not installed; the message has the command that installs it."""


def library(module: str, extra: str) -> ModuleType:
    """The driver library ``module``. Raises MissingExtra that names the extra of pyproject.toml that brings it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtra(f"{module} is not installed: pip install 'pecgrasp[{extra}]'") from error
