"""The cloud along one approach: thinned, turned, sorted by height, and the short side and the centre of its footprint.

These are the references of the functions of the same names in `compiled_backend`, which repeat their arithmetic: sums
and products stand in a fixed order. Clouds are rows (3, N), metres; the columns of `axes` (3, 3) are the axes, the
third of which points against the approach.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasping.geometry import exact_math

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def short_side(cloud: FloatArray, axes: FloatArray, cell: float) -> tuple[float, float]:
    """The direction, in the plane of the first two axes, of the least variance of the points.

    With a cell (m) each square cell of the footprint counts once, however densely it was seen; with 0 each point does.
    The sign is chosen so that the third moment along it is not negative: it belongs to the object, not to the axes.
    """
    x, y = exact_math.project(cloud, axes[:, 0]), exact_math.project(cloud, axes[:, 1])
    if cell > 0.0:
        key, columns = cells(x, y, cell)
        x, y = (index.astype(np.float64) for index in np.divmod(np.flatnonzero(np.bincount(key)), columns))
    x, y = x - exact_math.total(x) / len(x), y - exact_math.total(y) / len(y)
    angle = 0.5 * math.atan2(2.0 * exact_math.total(x * y), exact_math.total(x * x) - exact_math.total(y * y))
    across_x, across_y = -math.sin(angle), math.cos(angle)
    along = across_x * x + across_y * y
    return (-across_x, -across_y) if exact_math.total(along * along * along) < 0.0 else (across_x, across_y)


def thin(cloud: FloatArray, axes: FloatArray, box: float, depth: float) -> FloatArray:
    """The highest point of each box, that wide or a 200th of the cloud, and `depth` times as long along the approach.

    The highest of a box, and not any, so that the choice does not depend on the order of the points.
    """
    local = np.stack([exact_math.project(cloud, axis) for axis in axes.T])
    low, high = local.min(axis=1, keepdims=True), local.max(axis=1, keepdims=True)
    size = np.array([1.0, 1.0, depth])[:, None] * max(box, float((high - low).max()) / 200.0)
    index = ((local - low) / size).astype(np.int64)
    counts = index.max(axis=1) + 1
    key = (index[0] * counts[1] + index[1]) * counts[2] + index[2]
    order = np.argsort(local[2], kind="stable")
    kept = np.full(int(np.prod(counts)), -1, dtype=np.int64)
    kept[key[order]] = order  # the last one written, the highest, stays
    return np.ascontiguousarray(cloud[:, kept[kept >= 0]])


def place(
    cloud: FloatArray, axes: FloatArray, table_height: float | None, cell: float
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[float, float]]:
    """The cloud along its axes, in rising height, with the origin in its middle and at the table's height.

    Without a table the origin is at the lowest point. What lies under the table is its noise, and is put on it. Returns
    the points (3, N), what was subtracted (3,), an estimate of the centre of mass (2,): each cell (m) of the plane
    counts once, by the height of what stands in it, independent of how densely it was seen; and how far from it the
    farthest cell is, m, and the volume of what stands in all of them, m³.
    """
    local = np.stack([exact_math.project(cloud, axis) for axis in axes.T])
    local = np.take(local, np.argsort(local[2], kind="stable"), axis=1)
    middle = 0.5 * (local.min(axis=1) + local.max(axis=1))
    middle[2] = local[2, 0] if table_height is None else table_height
    local -= middle[:, None]
    if table_height is not None:
        np.maximum(local[2], 0.0, out=local[2])
    key, columns = cells(local[0], local[1], cell)
    highest = np.zeros(int(key.max()) + 1)
    highest[key] = np.maximum(local[2], 0.003)  # the last one written, the highest, stays
    taken = np.flatnonzero(highest)
    weight = highest[taken]
    places, total = np.divmod(taken, columns), exact_math.total(weight)
    centre = np.array([exact_math.total(weight * index) for index in places]) / total
    away, aside = places[0] - centre[0], places[1] - centre[1]
    footprint = cell * math.sqrt((away * away + aside * aside).max()), total * (cell * cell)
    return local, middle, local[:2].min(axis=1) + cell * (centre + 0.5), footprint


def neighbours(others: FloatArray, axes: FloatArray, middle: FloatArray, reach: FloatArray, cell: float) -> FloatArray:
    """Of neighbours (K, 3) the highest in each cell, along the axes (3, k), in rising height, from a middle (3,).

    Those within ± reach (2,): only seen along the approach is a neighbour out of reach. However high it is, a hand
    could hit it.
    """
    local = np.stack([exact_math.project(others.T, axis) - start for axis, start in zip(axes.T, middle, strict=True)])
    local = local[:, (np.abs(local[:2]) <= reach[:, None]).all(axis=0)]
    if not local.shape[1]:
        return local
    local = local[:, np.argsort(local[2], kind="stable")]
    return np.ascontiguousarray(local[:, np.sort(last_in_cells(local[0], local[1], cell))])


def last_in_cells(x: FloatArray, y: FloatArray, cell: float) -> NDArray[np.int64]:
    """Indices of the last point in each square cell of the plane: the highest, of points in rising height."""
    key, _ = cells(x, y, cell)
    last = np.full(int(key.max()) + 1, -1, dtype=np.int64)
    last[key] = np.arange(len(key))
    return last[last >= 0]


def cells(x: FloatArray, y: FloatArray, cell: float) -> tuple[IntArray, int]:
    """The cell (N,) of the plane that each point lies in, counted by lines, and the number of columns."""
    line, column = ((x - x.min()) / cell).astype(np.int64), ((y - y.min()) / cell).astype(np.int64)
    columns = int(column.max()) + 1
    return line * columns + column, columns
