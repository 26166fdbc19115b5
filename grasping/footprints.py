"""Tell things on a table apart by the places they stand on, seen along the table's normal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError, cKDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CELLS_A_GAP = 5
REACH = 2  # cells by which a footprint grows before footprints that touch are joined
NEIGHBOURS = 3.5  # points that a cell and the eight around it must hold, else they are noise


def label_footprints(flat: FloatArray, gap: float) -> tuple[IntArray, int]:
    """Label (N,) of the footprint that each point (N, 2) of the plane belongs to, −1 if isolated; number of footprints.

    Two things are surely told apart where 1.2 gaps lie between them, and what is less than 0.8 gaps apart stays one. A
    cloud whose points are more than a seventh of the gap apart is cut into larger cells and told apart less finely.
    """
    if not len(flat):
        return np.empty(0, dtype=np.int64), 0
    cell = max(gap / CELLS_A_GAP, 1.3 * _spacing(flat))
    index = ((flat - flat.min(axis=0)) / cell).astype(np.int64) + REACH + 1
    rows, columns = (int(size) for size in index.max(axis=0) + REACH + 2)
    key = index[:, 0] * columns + index[:, 1]
    counts = np.bincount(key, minlength=rows * columns).reshape(rows, columns)
    around = ndimage.uniform_filter(counts.astype(np.float32), 3, mode="constant") * 9.0
    dense = (counts > 0) & (around > NEIGHBOURS)
    grown = np.zeros_like(dense)
    steps = np.argwhere(np.hypot(*np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1]) < REACH + 0.5) - REACH
    for row, column in steps:
        moved = dense[REACH + row : rows - REACH + row, REACH + column : columns - REACH + column]
        grown[REACH:-REACH, REACH:-REACH] |= moved
    labelled, count = ndimage.label(grown, structure=np.ones((3, 3)))
    return np.where(dense, labelled, 0).reshape(-1)[key].astype(np.int64) - 1, int(count)


def convex_outline(flat: FloatArray) -> FloatArray | None:
    """Edges (E, 3) of the convex hull of points in the plane, a x + b y + c ≤ 0 inside; None where it has no area."""
    try:
        return np.asarray(ConvexHull(flat[:: max(1, len(flat) // 1000)]).equations)
    except (QhullError, ValueError):
        return None


def _spacing(flat: FloatArray) -> float:
    """Median distance (m) of 64 of the points to the nearest other one."""
    nearest, _ = cKDTree(flat).query(flat[:: max(1, len(flat) // 64)], k=2)
    finite = nearest[:, 1][np.isfinite(nearest[:, 1])]
    return float(np.median(finite)) if len(finite) else 0.0
