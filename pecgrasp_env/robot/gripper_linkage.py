"""The 2F-140's parallelogram: opening, crank angle, pad depth and the torque behind a squeeze, in closed form.

Two cranks of 0.1 m carry the fingers; the inner knuckles are their parallels, so the pads stay parallel and travel on
an arc: the wider the opening, the nearer they are to the palm (29 mm over the stroke). theta is a crank's angle from
the approach axis, the joint angle is q = CRANK_REST - theta (zero at an opening of 128.5 mm, growing in closing).

Gripper frame: z approach, y closing, x hinge; origin at the gripper's mounting face. Metres, radians, newtons.
The lengths are those of the public descriptions (ros-industrial `robotiq`, Webots `Robotiq2f140Gripper`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

STROKE = 0.140  # m, greatest opening
MIN_FORCE, MAX_FORCE = 10.0, 125.0  # N a pad
FORCE_RANGE_N = 250.0  # that is measured: twice what it can squeeze with; knocks beyond read as this
MAX_SPEED = 0.250  # m/s of opening

CRANK_LENGTH = 0.100
CRANK_PIVOT_Y, CRANK_PIVOT_Z = 0.030601, 0.054905
KNUCKLE_PIVOT_Y, KNUCKLE_PIVOT_Z = 0.0127, 0.06142  # the parallel (drawn only)
PAD_CENTRE_Y, PAD_CENTRE_Z = 0.027220, 0.045755  # in the finger's frame, y towards the other finger
PAD_WIDTH, PAD_LENGTH, PAD_THICKNESS = 0.027, 0.065, 0.0075  # along hinge, approach, closing

CRANK_REST = 0.7028  # rad, theta at q = 0
CRANK_LIMITS = (-0.0813, 0.7001)  # rad of q: openings 140.5 … -0.2 mm

_GAP_AT_ZERO = 2 * (CRANK_PIVOT_Y - PAD_CENTRE_Y) - PAD_THICKNESS  # -0.74 mm, at theta = 0
_DEPTH_AT_PIVOT = CRANK_PIVOT_Z + PAD_CENTRE_Z  # 100.66 mm


def crank_joint(opening: ArrayLike) -> np.ndarray:
    """Joint angle q (rad) of both cranks at an opening (m between the pad faces)."""
    return CRANK_REST - np.arcsin((np.asarray(opening, dtype=float) - _GAP_AT_ZERO) / (2 * CRANK_LENGTH))


def opening(crank_joint: ArrayLike) -> np.ndarray:
    """Opening (m) at a crank's joint angle (rad): the inverse of `crank_joint`."""
    return 2 * CRANK_LENGTH * np.sin(CRANK_REST - np.asarray(crank_joint, dtype=float)) + _GAP_AT_ZERO


def pad_depth(opening: ArrayLike) -> np.ndarray:
    """Distance (m) from the mounting face to the pads' centre along the approach axis, at an opening (m)."""
    return _DEPTH_AT_PIVOT + CRANK_LENGTH * np.cos(CRANK_REST - crank_joint(opening))


def crank_torque(force: ArrayLike, crank_joint: ArrayLike) -> np.ndarray:
    """Torque (N·m) each crank needs for a squeeze of `force` (N) at each pad: virtual work on the closing axis."""
    return np.asarray(force, dtype=float) * CRANK_LENGTH * np.cos(CRANK_REST - np.asarray(crank_joint, dtype=float))
