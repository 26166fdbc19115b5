"""Where two UR5 stand that work on one thing, and how they wait: opposite each other, the table's middle between them.

Whatever lies there across the line between them is as near to one as to the other, and their forearms come from
different sides. NumPy only; no simulator.
"""

from __future__ import annotations

import numpy as np

from pecgrasp_env.robot.kinematics import HOME

APART_M = 0.90  # between the two bases: a grasp 0.3 m off the line between them is 0.54 m from either
ARMS = ("arm_0", "arm_1")
T_WORLD_BASE = np.array([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])])  # (2, 4, 4); the first base is the world's frame
T_WORLD_BASE[1, 0, 3] = APART_M
T_WORLD_BASE.setflags(write=False)
MIDDLE = (APART_M / 2, 0.0)  # m, of the table between them

_ASIDE_RAD = 1.3  # turned so far, the hand hangs beside the table's middle, out of the camera's sight
WAITING = np.stack([HOME, HOME])  # (2, 6) rad
WAITING[:, 0] += (_ASIDE_RAD, -_ASIDE_RAD)
WAITING.setflags(write=False)


def in_base(T_world: np.ndarray, arm: int) -> np.ndarray:
    """A pose (…, 4, 4) of the world frame in the frame of an arm's base, 0 or 1."""
    return np.asarray(np.linalg.inv(T_WORLD_BASE[arm]) @ T_world)


def points_in_base(points: np.ndarray, arm: int) -> np.ndarray:
    """Points (N, 3) of the world frame in the frame of an arm's base."""
    R, t = T_WORLD_BASE[arm][:3, :3], T_WORLD_BASE[arm][:3, 3]
    return np.asarray((points - t) @ R)
