"""The cloud as the gripper sees it along one approach: heights against it, and what is known below the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.line_of_sight import Sight
from grasping.curvature_planner.projection import cells

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class ApproachView:
    """A frame with its third axis against the approach; `origin` in the middle of the object, seen so.

    axes: (3, 3) right-handed columns in the cloud's frame, the first two along the footprint's short and long axis.
    points: (3, N) x, y and height of the object in the frame, in rising height. obstacles: (3, K) likewise of what else
        is in the way.
    floor: height of the table, or of the lowest point seen. centre: (2,) estimate of the centre of mass. tilt: rad.
    sight: what the camera saw, in the frame. seen: (3, M) those of the points that were measured and not assumed, in
        any order.
    farthest: m of the footprint from the centre of mass. volume: m³, filled down to the floor.
    """

    origin: FloatArray
    axes: FloatArray
    points: FloatArray
    obstacles: FloatArray
    floor: float
    centre: FloatArray
    tilt: float
    sight: Sight
    seen: FloatArray
    farthest: float
    volume: float


def last_in_cells(x: FloatArray, y: FloatArray, cell: float) -> NDArray[np.int64]:
    """Indices of the last point in each square cell of the plane: the highest, of points in rising height."""
    key, _ = cells(x, y, cell)
    last = np.full(int(key.max()) + 1, -1, dtype=np.int64)
    last[key] = np.arange(len(key))
    return last[last >= 0]
