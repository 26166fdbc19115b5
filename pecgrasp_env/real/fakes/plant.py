"""What a stand-in moves. The plain one is a set of joints that follow exactly; the simulated robot is another."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.gripper_linkage import STROKE
from pecgrasp_env.robot.kinematics import home
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics


class Plant(Protocol):
    """period: s of one step. arm: whose joints it moves. q: (6,) rad and opening: m, both measured."""

    period: float
    arm: ArmLengths

    @property
    def q(self) -> np.ndarray: ...

    @property
    def opening(self) -> float: ...

    def step(self, q: np.ndarray, opening: float, force: float) -> None:
        """One period with these joint targets (6,) rad, opening target m, and grip force N."""

    def grab(self, T_base_camera: np.ndarray | None = None) -> tuple[np.ndarray, CameraIntrinsics]:
        """Depth (H, W), m, and intrinsics, of the wrist camera or of one beside the robot, at T_base_camera (4, 4).
        Raises ValueError where there is none.
        """

    def reset(self, seed: int) -> None:
        """Everything as at a start of its own, which the seed says."""

    def drop(self) -> None:
        """What is between the fingers is no longer there, as if it had slipped out."""

    def swap(self) -> None:
        """The asked-for thing and another have changed places, as if somebody had reached in. Raises ValueError where
        there is no other.
        """

    def report(self) -> dict[str, object]:
        """What only the plant knows, such as whether the right object is up."""


class FollowingJoints:
    """Joints and fingers that are where they are told to be; fingers stop at ``between``, m, a thing between them."""

    def __init__(self, period: float = 0.008, between: float = 0.0, arm: ArmLengths = UR5) -> None:
        self.period, self.arm = period, arm
        self.between = between
        self.reset(0)

    def reset(self, seed: int) -> None:
        self._q, self._opening = home(self.arm).copy(), STROKE
        self._dropped = False

    def drop(self) -> None:
        self._dropped = True

    def swap(self) -> None:
        raise ValueError("joints alone have no things to change places: fake-robot scene=simulated has some")

    @property
    def q(self) -> np.ndarray:
        return self._q

    @property
    def opening(self) -> float:
        return self._opening

    def step(self, q: np.ndarray, opening: float, force: float) -> None:
        self._q, self._opening = np.array(q), max(opening, 0.0 if self._dropped else self.between)

    def grab(self, T_base_camera: np.ndarray | None = None) -> tuple[np.ndarray, CameraIntrinsics]:
        raise ValueError("joints alone have no camera: fake-robot scene=simulated has one")

    def report(self) -> dict[str, object]:
        return {}
