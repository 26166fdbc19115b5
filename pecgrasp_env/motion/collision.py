"""What a posture of the arm would hit: the table, the objects on it as they were seen, the arm itself; and whether the
arm has room, on its way to an object and while it takes hold of it between the others.

The robot is spheres (`robot.body`). What was seen is a height map over the table: a camera above cannot see what is
below a surface, so everything under it counts as solid. A sphere hits it where its lower half reaches below the map.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.motion.rrt_connect import free_path
from pecgrasp_env.robot.collision_spheres import Spheres, body
from pecgrasp_env.robot.kinematics import HOME

CELL_M = 0.006
_EDGE = math.ceil(0.12 / CELL_M)  # empty cells round the map: beyond them nothing is in reach of a sphere
_BESIDE_ITSELF_M = 0.005
_MARGIN_M = 0.008  # from what was seen: noise, the height map's cells, and what was just not seen
_TABLE_M = 0.010
_ALWAYS_FREE = 2  # frames below it, base and shoulder, cannot come near the objects


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
            under, rise = _ball(size + margin, self._heights.shape[1])
            index = cell[:, 0] * self._heights.shape[1] + cell[:, 1]
            reached = (self._heights.take(index[:, None] + under) + rise).max(axis=1)
            hit[posture[height[posture, sphere] < reached]] = True
        return hit

    def near_table(self, centres: np.ndarray, radius: np.ndarray, margin: float) -> np.ndarray:
        """(N,) bool: whether a sphere of posture n is nearer than `margin` to the table's plane."""
        return (centres @ self._plane[:3] + self._plane[3] - radius < margin).any(axis=1)


@lru_cache(maxsize=256)
def _ball(radius: float, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """Of the cells under a ball (C,): their places in a flat map of so many columns, counted from the one under its
    centre, and how far below the centre it ends over each.
    """
    reach = math.ceil(radius / CELL_M)
    i, j = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    rest = radius**2 - CELL_M**2 * (i * i + j * j)
    under = rest >= 0
    return (i * columns + j)[under], np.sqrt(rest[under])


def hits_itself(robot: Spheres, centres: np.ndarray) -> np.ndarray:
    """(N,) bool: whether hand or wrist would meet the rest of the arm; centres (N, S, 3) of the robot's spheres."""
    hit = np.zeros(len(centres), bool)
    # The hand against base to forearm; the wrist's first two bodies against base and shoulder.
    for one, other in (((6, 6), (0, 3)), ((4, 5), (0, 1))):
        a, b = (slice(*np.searchsorted(robot.frame, (first, last + 1))) for first, last in (one, other))
        p, q = centres[:, a], centres[:, b]
        square = (p * p).sum(axis=2)[:, :, None] + (q * q).sum(axis=2)[:, None] - 2 * p @ q.swapaxes(1, 2)
        least = robot.radius[a][:, None] + robot.radius[b] + _BESIDE_ITSELF_M
        hit |= (square < least**2).any(axis=(1, 2))
    return hit


class Clearance:
    """The room around one object.

    Args:
        points: (M, 3) of the object, base frame, m; none where the arm only moves about.
        others: (K, 3) of all else that was seen.
        plane: the table (4,).
    """

    def __init__(self, points: np.ndarray, others: np.ndarray, plane: np.ndarray) -> None:
        self._others = Surroundings(others, plane)
        self._all = Surroundings(np.concatenate([points, others]), plane) if len(points) else self._others

    @property
    def top(self) -> float:
        """Of everything, m above the table."""
        return self._all.top

    def trouble_at_object(self, path: np.ndarray, opening: float, tight: bool) -> str | None:
        """What speaks against a path (K, 6) down to the object and up again with the hand at an opening (m), or None.

        The planner of grasps has seen to the fingertips' room and to the palm's above the object; this is about all
        else: cranks, camera and arm. tight: without a margin to the other objects.
        """
        robot = body(opening)
        centres = robot.at(path)
        moving = (robot.frame >= _ALWAYS_FREE) & ~robot.fingertip
        if self._others.near_table(centres[:, moving], robot.radius[moving], _TABLE_M).any():
            return "a link would come too near the table"
        if self._others.hit_by(centres[:, moving], robot.radius[moving], 0.0 if tight else _MARGIN_M).any():
            return "another object is in the arm's way"
        arm = moving & ~robot.gripper
        if self._all.hit_by(centres[:, arm], robot.radius[arm], 0.0).any():
            return "arm or camera would touch the object"
        if hits_itself(robot, centres[::2]).any():
            return "the arm would touch itself"
        return None

    def way(self, q_start: np.ndarray, q_goal: np.ndarray, opening: float = ROBOTIQ_2F_140.stroke) -> np.ndarray:
        """Joint waypoints (K, 6) past everything, the hand at an opening (m) or narrower.

        Raises MotionError where there is no such way.
        """
        robot = body(opening)
        moving = robot.frame >= _ALWAYS_FREE
        radius = robot.radius[moving]

        def free(q: np.ndarray) -> np.ndarray:
            centres = robot.at(q)
            blocked = hits_itself(robot, centres)
            blocked |= self._all.near_table(centres[:, moving], radius, _TABLE_M)
            blocked |= self._all.hit_by(centres[:, moving], radius, _MARGIN_M)
            return ~blocked

        return free_path(q_start, q_goal, free, over=(HOME,))
