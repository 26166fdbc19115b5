"""A collision-free path between two postures: straight where that is free, else over a posture above, else RRT-Connect.

RRT-Connect: Kuffner and LaValle, "RRT-Connect: an efficient approach to single-query path planning" (ICRA 2000). Its
random numbers come from a fixed seed, so the same question has the same answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.robot.arm_lengths import JOINT_LIMITS

Free = Callable[[np.ndarray], np.ndarray]  # postures (N, 6) → (N,) bool: whether each is free

STEP_RAD = 0.08  # between checked postures, greatest joint; 0.08 rad of the shoulder is 60 mm at the hand
_REACH_RAD = 0.5  # that a tree grows in one go
_SWERVE_RAD = 1.0  # beyond the two ends, in which samples are drawn
_SAMPLES = 300
_SHORTCUTS = 40


class NoPathError(MotionError):
    """No free path was found between two postures."""


def free_path(
    q_start: np.ndarray,
    q_goal: np.ndarray,
    free: Free,
    over: Iterable[np.ndarray] = (),
    limits: np.ndarray = JOINT_LIMITS,
) -> np.ndarray:
    """Joint waypoints (K, 6), K ≥ 2, from one posture to another through free postures.

    The start may touch something, as a hand among objects does: what follows it must be free.

    Args:
        over: postures (6,) to go over, tried one after another before the search.
        limits: (6, 2) rad.

    Raises:
        NoPathError: the goal is not free, or the search found nothing.
    """
    q_start, q_goal = np.asarray(q_start, float), np.asarray(q_goal, float)
    if not free(q_goal[None])[0]:
        raise NoPathError("something is in the way where the arm should go")
    if free_between(q_start, q_goal, free):
        return np.stack([q_start, q_goal])
    for q in over:
        if free_between(q_start, q, free) and free_between(q, q_goal, free):
            return np.stack([q_start, q, q_goal])
    return _shortened(_connect(q_start, q_goal, free, limits), free)


def free_between(a: np.ndarray, b: np.ndarray, free: Free) -> bool:
    """Whether the straight line in joint space, but for its start, is free."""
    return bool(free(between(a, b)).all())


def between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Postures (N, 6), N ≥ 1, on the straight line from a to b, without a and with b."""
    count = max(1, int(np.ceil(np.abs(b - a).max() / STEP_RAD)))
    return a + (b - a) * (np.arange(1, count + 1) / count)[:, None]


class _Tree:
    def __init__(self, root: np.ndarray) -> None:
        self.nodes = [root]
        self.parents = [-1]

    def grow(self, towards: np.ndarray, free: Free, reach: float) -> bool:
        """Grow from the nearest node as far as it is free; whether it got there."""
        nearest = int(np.square(np.array(self.nodes) - towards).sum(axis=1).argmin())
        start = self.nodes[nearest]
        step = towards - start
        length = np.abs(step).max()
        end = towards if length <= reach else start + step * (reach / length)
        steps = between(start, end)
        good = free(steps)
        last = len(steps) if good.all() else int(good.argmin())
        if last == 0:
            return False
        self.nodes.append(steps[last - 1])
        self.parents.append(nearest)
        return last == len(steps) and end is towards

    def path(self) -> list[np.ndarray]:
        """From the root to the node that was added last."""
        found, index = [], len(self.nodes) - 1
        while index >= 0:
            found.append(self.nodes[index])
            index = self.parents[index]
        return found[::-1]


def _connect(q_start: np.ndarray, q_goal: np.ndarray, free: Free, limits: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(0)
    low = np.maximum(np.minimum(q_start, q_goal) - _SWERVE_RAD, limits[:, 0])
    high = np.minimum(np.maximum(q_start, q_goal) + _SWERVE_RAD, limits[:, 1])
    trees = (_Tree(q_start), _Tree(q_goal))
    for sample in range(_SAMPLES):
        one, other = trees if sample % 2 == 0 else trees[::-1]
        before = len(one.nodes)
        one.grow(rng.uniform(low, high), free, _REACH_RAD)
        if len(one.nodes) > before and other.grow(one.nodes[-1], free, np.inf):
            there, back = (one, other) if one is trees[0] else (other, one)
            return np.array(there.path() + back.path()[-2::-1])
    raise NoPathError("no way round what is on the table was found")


def _shortened(path: np.ndarray, free: Free) -> np.ndarray:
    """The path without what a straight line between two of its postures leaves out."""
    rng = np.random.default_rng(0)
    for _ in range(_SHORTCUTS):
        if len(path) == 2:
            break
        i, j = np.sort(rng.choice(len(path), size=2, replace=False))
        if j > i + 1 and free_between(path[i], path[j], free):
            path = np.concatenate([path[: i + 1], path[j:]])
    return path
