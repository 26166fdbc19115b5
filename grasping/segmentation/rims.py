"""Join what is seen of a bowl: its near wall hides its bottom from a low camera, and the far wall stands behind alone.

The near wall's upper edge and the far one's are then arcs of one circle at one height, which no two things share.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

EDGE = 0.12  # of a wall's height below its top, and at least
LEAST_EDGE = 0.005  # m: its upper edge
SAME_HEIGHT = 0.10  # of the higher wall's height, and at least LEAST_EDGE
RADII = (0.03, 0.25)  # m, of vessels
ROUND = 0.05  # of the radius, and at least
LEAST_ROUND = 0.004  # m: how far half of an edge lies off the circle; twice as far nine tenths of it
SECTORS, SEEN = 16, 10  # of the circle, and how many of them the edges must cover
SAMPLED = 200  # points of an edge


def join_walls(walls: list[tuple[FloatArray, NDArray]]) -> list[list[int]]:
    """Groups of the numbers of things that are one vessel, each of one number otherwise.

    walls: of each thing where its points are on the table (M, 2) and above it (M,), m.
    """
    tops = [_top(height) for _, height in walls]
    group = list(range(len(walls)))
    for i, j in combinations(range(len(walls)), 2):
        alike = abs(tops[i] - tops[j]) <= max(SAME_HEIGHT * max(tops[i], tops[j]), LEAST_EDGE)
        if alike and group[i] != group[j] and _arcs_of_one_circle(_edge(*walls[i], tops[i]), _edge(*walls[j], tops[j])):
            group = [group[i] if each == group[j] else each for each in group]
    return [[i for i in range(len(walls)) if group[i] == number] for number in sorted(set(group))]


def _top(height: NDArray) -> float:
    """What all but a fiftieth of the heights are at most."""
    sample = height[:: max(1, len(height) // SAMPLED)]
    last = int(0.98 * (len(sample) - 1))
    return float(np.partition(sample, last)[last])


def _edge(flat: FloatArray, height: NDArray, top: float) -> FloatArray:
    index = np.flatnonzero(height > top - max(EDGE * top, LEAST_EDGE))
    return np.asarray(flat[index[:: max(1, len(index) // SAMPLED)]], dtype=np.float64)


def _arcs_of_one_circle(one: FloatArray, other: FloatArray) -> bool:
    apart = np.linalg.norm(one.mean(axis=0) - other.mean(axis=0))
    if min(len(one), len(other)) < 5 or apart > 2 * RADII[1]:
        return False
    both = np.vstack([one, other])
    middle = both.mean(axis=0)
    x, y = (both - middle).T
    weight = np.sqrt(np.repeat([1 / len(one), 1 / len(other)], [len(one), len(other)]))
    columns = np.column_stack([2 * x, 2 * y, np.ones(len(both))])
    (a, b, c), *_ = np.linalg.lstsq(columns * weight[:, None], (x * x + y * y) * weight, rcond=None)
    radius = float(np.sqrt(max(c + a * a + b * b, 0.0)))
    if not RADII[0] <= radius <= RADII[1]:
        return False
    off = np.abs(np.hypot(x - a, y - b) - radius)
    most = max(ROUND * radius, LEAST_ROUND)
    for each in (off[: len(one)], off[len(one) :]):
        if np.median(each) > most or np.quantile(each, 0.9) > 2 * most:
            return False
    angle = np.arctan2(y - b, x - a)
    return len(np.unique(np.floor(angle / (2 * np.pi) * SECTORS))) >= SEEN
