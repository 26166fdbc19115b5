"""Join what a hole in the depth divides: a dark or shiny stripe across a thing leaves two halves and nothing between.

Two things side by side look alike there, where nothing behind them is measured; but between their feet the table is
seen, and under a stripe it is not.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDEST = 0.05  # m across a hole
STEP = 0.012  # m in depth between its two sides, and
SLOPE = 0.5  # of its width
BRIDGED = 0.5  # of the lines of pixels that both parts are in
FEWEST = 5  # such lines
TABLE_SEEN = 0.2  # of the middles between the two sides, above which they are two things


def parts_over_holes(
    kept: list[IntArray],
    holes: NDArray[np.bool_],
    points: NDArray,
    distance: NDArray,
    viewpoint: FloatArray,
    table: IntArray,
    level: FloatArray,
    near: float,
) -> list[list[int]]:
    """Groups of the numbers of things that are one, of one number where nothing speaks for more.

    kept: of each thing its pixels. holes (H, W): nothing was measured. points (H·W, 3), distance (H·W,): of the pixels,
    the latter from the camera at the viewpoint (3,), m. table (T,): pixels that show the table, whose directions
    level (3, 2) are. near: m within which one of those shows the table at a place.
    """
    if len(kept) < 2:
        return [[i] for i in range(len(kept))]
    owner = np.full(holes.shape, -1, dtype=np.int32)
    for number, index in enumerate(kept):
        owner.reshape(-1)[index] = number
    # What lies between two things lies in the window about all of them.
    rows, columns = np.flatnonzero((owner >= 0).any(axis=1)), np.flatnonzero((owner >= 0).any(axis=0))
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    inside, numbers = holes[window], owner[window]
    corner, width = rows[0] * holes.shape[1] + columns[0], holes.shape[1]
    lines = [
        tuple(corner + row * width + column for row, column in _across(inside, numbers)),
        tuple(corner + row * width + column for column, row in _across(inside.T, numbers.T)),
    ]
    group = list(range(len(kept)))
    between = [np.sort(owner.reshape(-1)[[one, other]], axis=0) for one, other in lines]
    pairs = {(a, b) for own in between for a, b in own.T.tolist()}
    for a, b in combinations(range(len(kept)), 2):
        if (a, b) not in pairs or group[a] == group[b]:
            continue
        for axis, ((one, other), own) in enumerate(zip(lines, between, strict=True)):
            mine = np.flatnonzero((own[0] == a) & (own[1] == b))
            p, q = (points.take(each[mine], axis=0).astype(np.float64) for each in (one, other))
            wide = np.linalg.norm(p - q, axis=1)
            deep = np.abs(distance[one[mine]] - distance[other[mine]])
            level_with = (wide <= WIDEST) & (deep <= np.maximum(STEP, SLOPE * wide))
            crossed = np.unique(np.divmod(one[mine], holes.shape[1])[axis][level_with])
            in_a, in_b = (np.unique(np.divmod(kept[each], holes.shape[1])[axis]) for each in (a, b))
            both = np.count_nonzero(np.isin(in_a, in_b))
            if len(crossed) < max(FEWEST, BRIDGED * both):
                continue
            # Just behind the hole: the table in front of a thing is always seen.
            middles = (0.5 * (p + q))[level_with] @ level
            away = middles - viewpoint @ level
            middles += 2.0 * near * away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
            if _table_shown(middles, points.take(table, axis=0) @ level, near) <= TABLE_SEEN:
                group = [group[a] if each == group[b] else each for each in group]
                break
    return [[i for i in range(len(kept)) if group[i] == number] for number in sorted(set(group))]


def _across(holes: NDArray[np.bool_], owner: NDArray) -> tuple[tuple[IntArray, IntArray], tuple[IntArray, IntArray]]:
    """Rows and columns of the pixels on either side of each run of holes in a row that lies between two things."""
    holes = np.ascontiguousarray(holes)
    ends = holes[:, :-1] ^ holes[:, 1:]
    before = np.divmod(np.flatnonzero(ends & holes[:, 1:]), max(ends.shape[1], 1))
    row, column = np.divmod(np.flatnonzero(ends & holes[:, :-1]), max(ends.shape[1], 1))
    # The run that ends here is the last that began, unless it began with the row.
    began = np.searchsorted(before[0] * holes.shape[1] + before[1], row * holes.shape[1] + column) - 1
    found = np.flatnonzero(began >= 0)
    found = found[before[0][began[found]] == row[found]]
    row, first, last = row[found], before[1][began[found]], column[found] + 1
    one, other = owner[row, first], owner[row, last]
    two = np.flatnonzero((one >= 0) & (other >= 0) & (one != other))
    return (row[two], first[two]), (row[two], last[two])


def _table_shown(places: FloatArray, table: NDArray, near: float) -> float:
    """Share of places (P, 2) of the plane at which the table (T, 2) is seen."""
    low, high = places.min(axis=0) - near, places.max(axis=0) + near
    around = table[((table >= low) & (table <= high)).all(axis=1)]
    if not len(around):
        return 0.0
    return float(np.isfinite(cKDTree(around).query(places, distance_upper_bound=near)[0]).mean())
