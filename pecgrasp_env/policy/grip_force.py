"""How hard to hold an object of which nothing but its shape is known: gently what is flat, as usual what is not."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.robot.kinematics import UP

_GENTLE_N, _USUAL_N = 30.0, 60.0
_MORE_N = 40.0  # where it has slipped
_FLAT_M, _HIGH_M = 0.010, 0.016  # up to the first the gentle force, from the second on the usual one
_CELL_M = 0.004


def grip_force(points: np.ndarray, plane: np.ndarray | None, slipped: bool) -> float:
    """The force (N) for an object (M, 3) in the base frame on a table (4,), or on z = 0.

    60 N on the edges of a flat thing roll it up or squeeze it out; with less than that pliers, which are small and
    heavy, turn and slide out. slipped: it has slid out of a hold before.
    """
    share = np.clip((mean_height(points, plane) - _FLAT_M) / (_HIGH_M - _FLAT_M), 0.0, 1.0)
    force = _GENTLE_N + share * (_USUAL_N - _GENTLE_N)
    return float(force + _MORE_N if slipped else force)


def mean_height(points: np.ndarray, plane: np.ndarray | None) -> float:
    """m of the seen surface above the table, over the footprint."""
    normal, offset = (UP, 0.0) if plane is None else (plane[:3], plane[3])
    height = points @ normal + offset
    cell = np.unique(np.floor(points[:, :2] / _CELL_M).astype(np.int64), axis=0, return_inverse=True)[1].reshape(-1)
    top = np.zeros(cell.max() + 1)
    np.maximum.at(top, cell, height)
    return float(top.mean())
