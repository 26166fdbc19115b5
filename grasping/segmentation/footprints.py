"""Tell things on a table apart by the places they stand on, seen along the table's normal."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CELLS_A_GAP = 5
REACH = 2  # cells by which a footprint grows before footprints that touch are joined
AREA_CELL = 0.02  # m, in which a surface's area is counted
OF_OUTLINE = 500  # points that suffice for an outline
NEIGHBOURS = 3.5  # points that a cell and the eight around it must hold, else they are noise


def label_footprints(flat: FloatArray, gap: float, pitch: float) -> IntArray:
    """Label (N,) of the footprint that each point (N, 2) of the plane belongs to, −1 if isolated.

    Two things are surely told apart where 1.2 gaps lie between them, and what is less than 0.8 gaps apart stays one. A
    cloud whose points lie farther apart than a fifth of the gap, `pitch` (m), is told apart less finely.
    """
    if not len(flat):
        return np.empty(0, dtype=np.int64)
    cell = max(gap / CELLS_A_GAP, pitch)
    index = ((flat - flat.min(axis=0)) / cell).astype(np.int64) + REACH + 1
    rows, columns = (int(size) for size in index.max(axis=0) + REACH + 2)
    key = index[:, 0] * columns + index[:, 1]
    counts = np.bincount(key, minlength=rows * columns).reshape(rows, columns)
    # The margin is empty, so that what a sum lacks at the border is nothing.
    along = counts[1:-1].copy()
    along += counts[:-2]
    along += counts[2:]
    around = along[:, 1:-1] + along[:, :-2] + along[:, 2:]
    dense = counts > 0
    dense[1:-1, 1:-1] &= around > NEIGHBOURS
    # By a disc of two cells: a square of one cell around, then a cross of one.
    square = _spread(_spread(dense, 0), 1)
    grown = _spread(square, 0) | _spread(square, 1)
    labelled, _ = ndimage.label(grown, structure=np.ones((3, 3)))
    return np.where(dense, labelled, 0).reshape(-1)[key].astype(np.int64) - 1


def _spread(mask: NDArray[np.bool_], axis: int) -> NDArray[np.bool_]:
    """The mask (H, W) and its neighbours before and after along an axis."""
    spread = mask.copy()
    target, source = (spread, mask) if axis == 0 else (spread.T, mask.T)
    target[1:] |= source[:-1]
    target[:-1] |= source[1:]
    return spread


def convex_outline(flat: FloatArray, most: int = OF_OUTLINE) -> FloatArray | None:
    """Edges (E, 3) of the convex hull of some of the points in the plane, a x + b y + c ≤ 0 inside; None where it has
    no area.
    """
    try:
        return np.asarray(ConvexHull(flat[:: max(1, len(flat) // most)]).equations)
    except (QhullError, ValueError):
        return None


def spacing(flat: FloatArray, count: int) -> float:
    """Mean distance (m) between the points of a surface, from a sample (S, 2) of its `count` points."""
    along, across = np.floor(flat.T / AREA_CELL).astype(np.int64)
    cells = np.sort(along * 1_000_003 + across)
    filled = min(len(cells), 1) + np.count_nonzero(cells[1:] != cells[:-1])
    return AREA_CELL * float(np.sqrt(filled / count))
