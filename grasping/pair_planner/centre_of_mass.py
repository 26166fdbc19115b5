"""Where the weight of an object is, estimated from a cloud that shows one side of it.

What is known completes the cloud. Each cell of the footprint is a column from the seen surface down to the table. Only
where the object is about as wide as it is high and its top is curved across the long axis, as a handle's is, the seen
upper half of the cross-section is mirrored instead: its head may hold it off the table. A cell that the object itself
hides from the camera is as high as its mirror image across the long axis, where that was seen: what is long is as a
rule alike on both sides. Density is taken as uniform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.geometry.principal_axes import principal_axes

FloatArray = NDArray[np.float64]

CELL, FINEST = 0.006, 0.002  # m of the footprint, at most and at least
THINNEST = 0.001  # m above the table
ROUND = 1.3  # times as wide as high, up to which a cross-section may be round
CURVED = 0.08  # of half the width, by which a quarter of its top is lower: 0.34 on a circle, 0 on a beam
LOOKS = 24  # places along a line of sight at which something may hide what is behind


@dataclass(frozen=True)
class Footprint:
    """The object over its table, as columns.

    axes: (3, 3) columns: along the object, across it, up. low, high: (2,) m, its extent along the first two of them.
    centre: (3,) m, estimated centre of mass, in the cloud's frame. volume: m³ of all columns. hidden: share of that
    volume that is only mirrored.
    """

    axes: FloatArray
    low: FloatArray
    high: FloatArray
    centre: FloatArray
    volume: float
    hidden: float


def footprint(points: FloatArray, table: FloatArray, viewpoint: FloatArray | None) -> Footprint:
    """The columns of a cloud (N, 3), m, over a table (4,) whose normal points up; viewpoint: (3,) of the camera.

    Without a viewpoint nothing counts as hidden. Points at or below the table stand for columns of a millimetre.
    """
    up = table[:3]
    first = np.cross(up, np.eye(3)[int(np.abs(up).argmin())])
    first /= np.linalg.norm(first)
    level = np.column_stack([first, np.cross(up, first)])
    flat = points @ level
    # Of cells, not of points: where the camera is near, points are dense.
    cells = np.unique(np.floor(flat / CELL), axis=0)
    # As wide as the points are apart, which on the average neither adds to the outline nor takes from it.
    cell = float(np.clip(CELL * np.sqrt(len(cells) / len(points)), FINEST, CELL))
    along = level @ principal_axes(cells)[:, 0]
    axes = np.column_stack([along, np.cross(up, along), up])
    place = points @ axes[:, :2]
    low, high = place.min(axis=0), place.max(axis=0)
    # Cells end at both sides of the extent, so that turning the map over mirrors it about the object's middle.
    shape = np.maximum(1, np.ceil((high - low) / cell).astype(int))
    size = (high - low) / shape
    size = np.where(size > 0, size, cell)
    index = np.minimum(((place - low) / size).astype(int), shape - 1)
    top = np.zeros(shape)
    np.maximum.at(top, tuple(index.T), np.maximum(points @ up + table[3], THINNEST))
    top = _closed(top)
    seen = top.sum()
    x, y = (low[k] + (np.arange(shape[k]) + 0.5) * size[k] for k in range(2))
    if viewpoint is not None:
        eye = np.append(viewpoint @ axes[:, :2], viewpoint @ up + table[3])
        mirrored = top[:, ::-1]
        empty = np.argwhere((top == 0) & (mirrored > 0))
        unseen = tuple(empty[_hidden(empty, top, low, size, eye)].T)
        top[unseen] = mirrored[unseen]
    column = _thickness(top, size[1])
    total = column.sum()
    middle = np.array([(column.sum(axis=1) @ x) / total, (column.sum(axis=0) @ y) / total])
    height = float((column * (top - column / 2)).sum() / total) - table[3]
    centre = axes @ np.append(middle, height)
    return Footprint(axes, low, high, centre, float(total * size.prod()), float(1 - seen / top.sum()))


def _closed(top: FloatArray) -> FloatArray:
    """Without holes of a single cell, which have the lower of their neighbours along or across."""
    wide = np.pad(top, 1)
    along = np.minimum(wide[:-2, 1:-1], wide[2:, 1:-1])
    across = np.minimum(wide[1:-1, :-2], wide[1:-1, 2:])
    return np.where(top > 0, top, np.maximum(along, across))


def _thickness(top: FloatArray, cell: float) -> FloatArray:
    """How much of each column (K, L) is solid, m; K stations along the object, cells of so many m across it."""
    taken = top > 0
    first, last = taken.argmax(axis=1), taken.shape[1] - taken[:, ::-1].argmax(axis=1)
    width = _around(np.where(taken.any(axis=1), last - first, 0) * cell)
    high = _around(top.max(axis=1))
    bars = np.zeros(len(top), bool)
    for k in np.flatnonzero((width > 0) & (width <= ROUND * high) & taken.any(axis=1)):
        row = top[k, taken[k]]
        bars[k] = row.max() - np.quantile(row, 0.25) > CURVED * width[k] / 2
    middle = high - np.minimum(width, high) / 2
    return np.where(bars[:, None], np.maximum(0.0, 2 * (top - middle[:, None])), top)


def _around(values: FloatArray) -> FloatArray:
    """(K,) the largest of each station and its neighbours: the edges of a cloud are ragged."""
    return np.asarray(np.lib.stride_tricks.sliding_window_view(np.pad(values, 1), 3).max(axis=1))


def _hidden(
    cells: NDArray[np.int64], top: FloatArray, low: FloatArray, size: FloatArray, eye: FloatArray
) -> NDArray[np.bool_]:
    """Whether columns stand between the eye (3,) and the table in cells (M, 2)."""
    at = low + (cells + 0.5) * size
    if eye[2] <= 0:
        return np.ones(len(cells), dtype=bool)
    share = np.linspace(0.0, min(1.0, float(top.max()) / eye[2]), LOOKS + 1)[1:]
    line = at[:, None] + share[:, None] * (eye[:2] - at)[:, None]  # (M, LOOKS, 2)
    index = np.floor((line - low) / size).astype(int)
    inside = np.asarray(((index >= 0) & (index < top.shape)).all(axis=2))
    index = np.where(inside[..., None], index, 0)
    above = np.where(inside, top[index[..., 0], index[..., 1]], 0.0)
    return np.asarray((above > share * eye[2]).any(axis=1))
