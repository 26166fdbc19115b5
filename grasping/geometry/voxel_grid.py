"""A grid of cubes over a cloud, through the origin and along the axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def cubes(points: NDArray, size: float) -> IntArray:
    """Number (N,) of the cube, `size` m wide, that each of the points (N, 3) is in: from 0 without gaps, in order."""
    corner = np.floor(points / size).astype(np.int64)
    corner -= corner.min(axis=0)
    count = corner.max(axis=0) + 1
    key = (corner[:, 0] * count[1] + corner[:, 1]) * count[2] + corner[:, 2]
    return np.unique(key, return_inverse=True)[1].reshape(-1).astype(np.int64)


def cube_means(values: NDArray, numbers: IntArray) -> FloatArray:
    """Means (B, d) of the values (N, d) over each of the B cubes."""
    sums = np.column_stack([np.bincount(numbers, weights=column) for column in values.T])
    return sums / np.bincount(numbers)[:, None]
