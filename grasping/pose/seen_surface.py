"""Which of a mesh's surface can be seen from outside at all, and from which side.

Meshes hold more than that: the motor in a drill, the inner shell of a wall. No camera sees it, so no model has it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

DIRECTIONS = 120  # from which the surface is looked at
FEWEST = 2  # of them must see a point: one may look through between two samples
_CELL = 3.0  # of a picture, in distances of the samples: nine samples hide what is behind a cell
_SLACK = 1.5  # cells behind the nearest sample of its cell a point may be, as a slope has it
_STEEPEST = 0.2  # cosine of the line of sight with the normal, below which a surface is not looked at


def directions_around(count: int) -> FloatArray:
    """Unit vectors (count, 3), evenly spread (the Fibonacci spiral)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.arange(count) * math.pi * (3 - math.sqrt(5))
    flat = np.sqrt(1 - z * z)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


def times_seen(points: FloatArray, normals: FloatArray, area: float) -> NDArray[np.int64]:
    """How often each of many points (M, 3) with normals (M, 3) is seen from before it and from behind it, (M, 2).

    The points are uniform over a surface of that area, m², and hide one another; the views are from infinity.
    """
    cell = _CELL * math.sqrt(area / len(points))
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    reach = float(np.linalg.norm(points - middle, axis=1).max())
    side = math.ceil(2 * reach / cell) + 2
    times = np.zeros((len(points), 2), np.int64)
    for view in directions_around(DIRECTIONS):
        helper = np.eye(3)[np.abs(view).argmin()]
        right = np.cross(view, helper)
        right /= np.linalg.norm(right)
        local = (points - middle) @ np.stack([right, np.cross(view, right), view], axis=1)
        column, row = (np.floor((local[:, :2] + reach) / cell).astype(np.int64) + 1).T
        where = row * side + column
        top = np.full(side * side, -np.inf)
        np.maximum.at(top, where, local[:, 2])
        open_to_view = local[:, 2] >= top[where] - _SLACK * cell
        facing = normals @ view
        times[:, 0] += open_to_view & (facing > _STEEPEST)
        times[:, 1] += open_to_view & (facing < -_STEEPEST)
    return times
