"""What a posture of the arm would hit: the table, the objects on it as they were seen, the arm itself.

The robot is spheres (`pecgrasp_env.robot.collision_spheres`). What was seen is a height map over the table: a camera
above cannot see what is below a surface, so everything under it counts as solid. A sphere hits it where its lower half
reaches below the map.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from pecgrasp_env.robot.collision_spheres import Spheres

CELL_M = 0.006
_EDGE = math.ceil(0.12 / CELL_M)  # empty cells round the map: beyond them nothing is in reach of a sphere
_BESIDE_ITSELF_M = 0.005


class Surroundings:
    """The table and what stands on it.

    Args:
        points: (K, 3) of everything that was seen above the table, base frame, m; none is an empty table.
        plane: the table (4,), n · p + d = 0 with n of length one and nearly vertical.
    """

    def __init__(self, points: np.ndarray, plane: np.ndarray) -> None:
        self._plane = plane
        height = points @ plane[:3] + plane[3]
        points, height = points[height > 0], height[height > 0]
        self.top = float(height.max(initial=0.0))  # m above the table
        self._corner = points[:, :2].min(axis=0) if len(points) else np.zeros(2)
        cells = ((points[:, :2] - self._corner) / CELL_M).astype(int)
        shape = cells.max(axis=0, initial=-1) + 1 + 2 * _EDGE
        self._heights = np.full(shape, -np.inf)
        np.maximum.at(self._heights, tuple((cells + _EDGE).T), height)

    def hit_by(self, centres: np.ndarray, radius: np.ndarray, margin: float) -> np.ndarray:
        """(N,) bool: whether any of the spheres of posture n, centres (N, S, 3) and radii (S,), is nearer than `margin`
        to anything seen. Spheres of more than 0.1 m do not occur.
        """
        height = centres @ self._plane[:3] + self._plane[3]
        low = height - radius - margin < self.top
        hit = np.zeros(len(centres), bool)
        for size in set(radius[low.any(axis=0)].tolist()):
            posture, sphere = np.nonzero(low & (radius == size))
            cell = np.floor((centres[posture, sphere, :2] - self._corner) / CELL_M).astype(int) + _EDGE
            reach = math.ceil((size + margin) / CELL_M)
            inside = ((cell >= reach) & (cell < np.array(self._heights.shape) - reach)).all(axis=1)
            posture, sphere, cell = posture[inside], sphere[inside], cell[inside]
            row, column, rise = _ball(size + margin)
            under = row * self._heights.shape[1] + column  # in the flat map, counted from the cell under the centre
            index = cell[:, 0] * self._heights.shape[1] + cell[:, 1]
            reached = (self._heights.take(index[:, None] + under) + rise).max(axis=1)
            hit[posture[height[posture, sphere] < reached]] = True
        return hit

    def near_table(self, centres: np.ndarray, radius: np.ndarray, margin: float) -> np.ndarray:
        """(N,) bool: whether a sphere of posture n is nearer than `margin` to the table's plane."""
        return (centres @ self._plane[:3] + self._plane[3] - radius < margin).any(axis=1)


@lru_cache(maxsize=256)  # there are fewer radii; what a map's size made of them would be new with each scene
def _ball(radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the cells under a ball (C,): their rows and columns, counted from the one under its centre, and how far below
    the centre it ends over each.
    """
    reach = math.ceil(radius / CELL_M)
    i, j = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    rest = radius**2 - CELL_M**2 * (i * i + j * j)
    under = rest >= 0
    return i[under], j[under], np.sqrt(rest[under])


def hits_itself(robot: Spheres, centres: np.ndarray) -> np.ndarray:
    """(N,) bool: whether hand or wrist would meet the rest of the arm; centres (N, S, 3) of the robot's spheres."""
    hit = np.zeros(len(centres), bool)
    # The hand against base to forearm; the wrist's first two bodies against base and shoulder.
    for one, other in (((6, 6), (0, 3)), ((4, 5), (0, 1))):
        a, b = (slice(*np.searchsorted(robot.frame, (first, last + 1))) for first, last in (one, other))
        gap = sphere_gap(centres[:, a], robot.radius[a], centres[:, b], robot.radius[b])
        hit |= gap < _BESIDE_ITSELF_M
    return hit


def sphere_gap(p: np.ndarray, radius_p: np.ndarray, q: np.ndarray, radius_q: np.ndarray) -> np.ndarray:
    """(N,) m between the nearest two spheres of two sets, less than 0 where they meet; centres (N, S, 3) and (N, T, 3),
    or one of the two with N = 1, radii (S,) and (T,).
    """
    square = (p * p).sum(axis=2)[:, :, None] + (q * q).sum(axis=2)[:, None] - 2 * p @ q.swapaxes(1, 2)
    distance = np.sqrt(np.maximum(square, 0.0)) - radius_p[:, None] - radius_q
    return np.asarray(distance.min(axis=(1, 2)))
