"""What an arm, a two-finger gripper and a depth camera must be able to do. Any class with these methods will do.

Metres, radians, seconds, newtons. `T_base_tool0` maps the flange's points into the arm's base frame, whose z axis
points up (`pecgrasp_env.robot.kinematics`). All of them raise `RobotError`s (`pecgrasp_env.real.errors`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from pecgrasp_env.robot.arm_lengths import ArmLengths
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics


@dataclass(frozen=True)
class ArmState:
    """q: (6,) rad, measured. qd: (6,) rad/s. time: s, the controller's clock, which may run slower than ours."""

    q: np.ndarray
    qd: np.ndarray
    time: float


@dataclass(frozen=True)
class DepthImage:
    """depth: (H, W) float32 m along the optical axis, 0 for none. time: s, when it was taken, of the camera's clock."""

    depth: np.ndarray
    intrinsics: CameraIntrinsics
    time: float


@runtime_checkable
class Motion(Protocol):
    """A motion that goes on while one does something else."""

    @property
    def done(self) -> bool:
        """Whether it has ended, for whatever reason."""

    def wait(self, timeout: float) -> None:
        """Return once it is finished. Raises MotionTimeout after ``timeout`` s of our clock, in which case it goes on,
        and the error that ended it where one did.
        """

    def cancel(self) -> None:
        """Slow down and stop; returns at rest."""


@runtime_checkable
class Arm(Protocol):
    """Six joints. ``lengths``: by which joint angles are poses. ``speed`` and ``acceleration``: the most that any
    motion uses of a joint, rad/s and rad/s².
    """

    lengths: ArmLengths

    speed: float
    acceleration: float

    @property
    def state(self) -> ArmState: ...

    def move_joints(self, path: np.ndarray) -> Motion:
        """Along a polyline of joint waypoints (K, 6) from where the arm is. Raises JointLimit before anything moves."""

    def move_linear(self, T_base_tool0: np.ndarray) -> Motion:
        """The flange in a straight line, turning evenly. Raises MotionError where the arm cannot do that."""

    def follow(self, q: np.ndarray, duration: float) -> Motion:
        """Evenly to joint angles (6,) within ``duration`` s, and without a halt if another target follows in time."""

    def stop(self) -> None:
        """Slow down and stop whatever goes on; returns at rest."""

    def recover(self) -> None:
        """Make it ready again after an error; says nothing about whether that is safe, so ask the user first."""

    def close(self) -> None: ...


@runtime_checkable
class ParallelGripper(Protocol):
    """Two parallel fingers."""

    @property
    def width(self) -> float:
        """Opening between the pads, m, measured."""

    @property
    def is_holding(self) -> bool:
        """Whether the fingers were stopped by something while they closed."""

    def check(self) -> None:
        """Raises GripperFault where it is not ready to move or reports a fault."""

    def move(self, width: float, speed: float, force: float) -> Motion:
        """To an opening, m, with m/s and N; what stands in the way ends the motion, which is no error."""

    def close(self) -> None: ...


@runtime_checkable
class DepthCamera(Protocol):
    """A depth camera, wherever it is mounted."""

    def grab(self) -> DepthImage:
        """A frame that was taken after the call."""

    def close(self) -> None: ...
