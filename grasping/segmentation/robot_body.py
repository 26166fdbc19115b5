"""Which points of a frame lie on the robot itself: a hand and an arm in view are no objects.

What stands behind them was not measured, like what stands behind a hole in the depth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.errors import CloudError
from grasping.validation import LARGEST_OBJECT, as_cloud

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BEYOND_POINTS = 0.020  # m from a point of the surface, so that points 3 cm apart leave nothing between them
BEYOND_SPHERES = 0.015  # m from a sphere: noise, cables, a calibration that is some millimetres off
CELL = 0.03  # m, of the grid that says at once of most points that they are nowhere near
MOST_CELLS = 128  # along its longest side


class RobotBody:
    """A robot's surface as points (K, 3), or its body as spheres (K, 4), x y z radius, m, in the frame of the cloud.

    K may be 0. Raises CloudError for anything else.
    """

    def __init__(self, robot: ArrayLike) -> None:
        spheres = np.asarray(robot)
        if spheres.ndim != 2 or spheres.shape[1] not in (3, 4):
            raise CloudError(
                f"robot: shape {spheres.shape}, expected points (K, 3) or spheres (K, 4), each x, y, z and radius"
            )
        self._centre = as_cloud(spheres[:, :3], name="robot")
        self._reach = np.full(len(spheres), BEYOND_POINTS)
        if spheres.shape[1] == 4:
            radius = spheres[:, 3].astype(np.float64)
            if len(radius) and not (radius.min() >= 0.0 and radius.max() <= LARGEST_OBJECT):
                raise CloudError(
                    f"robot: radii from {radius.min():g} to {radius.max():g}, expected 0 to {LARGEST_OBJECT:g} m"
                )
            self._reach = radius + BEYOND_SPHERES

    def within(self, points: NDArray, beyond: float = 0.0) -> IntArray:
        """Which of the points (N, 3) are in reach of the body or so many metres beyond it: their numbers, rising."""
        centre, reach = _meeting(points, self._centre, self._reach + beyond)
        if not len(centre):
            return np.empty(0, dtype=np.int64)
        index, near = _near(points, centre, reach)
        # Spheres of several radii become points of one: a fourth coordinate takes up what the smaller ones lack.
        largest = float(reach.max())
        tree = cKDTree(np.column_stack([centre, np.sqrt(largest**2 - reach**2)]))
        distance, _ = tree.query(np.column_stack([near, np.zeros(len(near))]), distance_upper_bound=largest)
        return np.asarray(index[np.isfinite(distance)])


def _meeting(points: NDArray, centre: FloatArray, reach: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Those of the spheres (K, 3), (K,) that reach into the box around the points (N, 3): most of an arm is behind."""
    if not len(points):
        return centre[:0], reach[:0]
    low = np.array([np.fmin.reduce(along) for along in points.T], dtype=np.float64)
    high = np.array([np.fmax.reduce(along) for along in points.T], dtype=np.float64)
    meets = ((centre + reach[:, None] >= low) & (centre - reach[:, None] <= high)).all(axis=1)
    return centre[meets], reach[meets]


def _near(points: NDArray, centre: FloatArray, reach: FloatArray) -> tuple[IntArray, NDArray]:
    """The points (N, 3) in the cells of a grid that spheres touch: their numbers (M,), and themselves (M, 3)."""
    low, high = (centre - reach[:, None]).min(axis=0), (centre + reach[:, None]).max(axis=0)
    depth = points[:, 2]  # a camera's first: most of what it sees is behind a hand
    index = np.flatnonzero((depth >= low[2]) & (depth <= high[2]))  # which NaN is not
    for axis in (1, 0):
        along = points[:, axis].take(index)
        index = index[(along >= low[axis]) & (along <= high[axis])]
    cell = max(CELL, float((high - low).max()) / MOST_CELLS)
    touched = np.zeros(np.floor((high - low) / cell).astype(np.int64) + 1, dtype=bool)
    first = np.floor((centre - reach[:, None] - low) / cell).astype(np.int64)
    last = np.floor((centre + reach[:, None] - low) / cell).astype(np.int64)
    for (i, j, k), (u, v, w) in zip(first.tolist(), last.tolist(), strict=True):
        touched[i : u + 1, j : v + 1, k : w + 1] = True
    inside = points.take(index, axis=0).astype(np.float64)
    at = np.minimum(((inside - low) / cell).astype(np.int64), np.array(touched.shape) - 1)
    found = touched[tuple(np.maximum(at, 0).T)]
    return index[found], inside[found]
