"""Where an arm may be: a box, and a table's height; looked up before each target is sent."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.kinematics import T_TOOL0_GRIPPER, forward_kinematics

_CHECKED_RAD = 0.05  # between two postures of a path that are looked up
_TIP_SLACK_M = 0.003  # of what is planned to be 1 mm above the table, with fingers that close meanwhile


class OutsideWorkspace(RobotError):
    """A target would bring the hand out of the box, or through the table. Nothing was sent."""


@dataclass(frozen=True)
class Workspace:
    """low, high: (3,) m, base frame, of a box that flange and fingertips stay in. table: m, height of its top in the
    base frame; no fingertip goes below it. max_force: N between the pads.
    """

    low: tuple[float, float, float] = (-0.2, -0.6, -0.01)
    high: tuple[float, float, float] = (0.9, 0.6, 1.1)
    table: float = 0.0
    max_force: float = 125.0

    def check(self, q: np.ndarray, opening: float, arm: ArmLengths = UR5) -> None:
        """Raises OutsideWorkspace, which says what is where, for joint angles (6,), rad, of an arm, and a measured
        opening, m.
        """
        points = hand_points(np.asarray(q, float), opening, arm)
        low, high = np.array(self.low), np.array(self.high)
        for name, point in zip(("flange", *["fingertip"] * 4), points, strict=True):
            outside = (point < low) | (point > high)
            if outside.any():
                axis = int(np.argmax(outside))
                limits = f"{low[axis]} … {high[axis]}"
                raise OutsideWorkspace(f"the {name} would be at {'xyz'[axis]} = {point[axis]:.3f} m, outside {limits}")
        lowest = float(points[1:, 2].min())
        if lowest < self.table - _TIP_SLACK_M:
            raise OutsideWorkspace(f"a fingertip would be at z = {lowest:.3f} m, below the table at {self.table} m")

    def check_path(self, path: np.ndarray, opening: float, arm: ArmLengths = UR5) -> None:
        """`check` all along joint waypoints (K, 6), rad, the hand at an opening, m."""
        self.check(path[0], opening, arm)
        for start, end in pairwise(path):
            steps = max(1, int(np.ceil(np.abs(end - start).max() / _CHECKED_RAD)))
            for share in np.linspace(0, 1, steps + 1)[1:]:
                self.check(start + share * (end - start), opening, arm)


def hand_points(q: np.ndarray, opening: float, arm: ArmLengths = UR5) -> np.ndarray:
    """(5, 3) m, base frame: the flange, and the four inner corners of the pads' tips."""
    hand, T = ROBOTIQ_2F_140, forward_kinematics(q, arm)
    y, z = opening / 2, float(hand.pad_depth(opening)) + hand.pad_length / 2
    x = hand.finger_width / 2
    tips = np.array([[sx * x, sy * y, z, 1.0] for sx in (-1, 1) for sy in (-1, 1)])
    return np.vstack([T[:3, 3], (T @ T_TOOL0_GRIPPER @ tips.T)[:3].T])
