"""Tell neighbours apart in an organised frame: where table is seen between two things, they are two.

Footprints (`footprints`) join what is nearer than the gap; the picture knows more: between two things side by side
there are pixels of table, and between the parts of one thing there are none. A pixel or two at an edge, which flies
between two things, does not make them one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BRIDGE = 3  # pixels side by side; what hangs together by fewer is two things, if both are large
LARGE = 120  # pixels of a thing, without its border
NEAREST_PAIRS = 9  # pairs of pixels between two fragments that are looked between
NEIGHBOURS = 0.03  # m; what lies farther apart hangs together only by what is between
TABLE = 0.4  # of the lower fragment's height: what lies lower between them is table and no noise on one thing


def split_by_table(
    labels: IntArray, chosen: IntArray, flat: FloatArray, height: NDArray, shape: tuple[int, int], least: int
) -> IntArray:
    """Labels (C,) anew: clusters between whose parts the table is seen fall into these parts.

    labels: of the points `chosen` (C,), which are pixels of a frame (H, W), −1 for none. flat: (C, 2) where they are on
    the table, m. height: (H·W,) of all pixels above it, m, NaN for none. least: pixels; smaller fragments stay with the
    nearest.
    """
    if not len(chosen):
        return labels
    rows, columns = np.divmod(chosen, shape[1])
    first = rows.min(), columns.min()
    # A row and a column wider than what is seen, so that erosion sees where it ends.
    picture = np.zeros((rows.max() - first[0] + 3, columns.max() - first[1] + 3), dtype=bool)
    at = rows - first[0] + 1, columns - first[1] + 1
    picture[at] = labels >= 0
    inner = ndimage.binary_erosion(picture)
    parts, origin = _fragments(picture, inner)
    part, border = parts[at], ~inner[at]
    sizes = np.bincount(part, minlength=len(origin))
    result = labels.copy()
    fresh = int(labels.max(initial=-1)) + 1
    for label in np.flatnonzero(np.bincount(labels[labels >= 0])):
        members = np.flatnonzero(labels == label)
        here = np.flatnonzero(np.bincount(part[members], minlength=len(origin)))
        large = here[sizes[here] >= least]
        if len(large) < 2:
            continue
        whole = [members[part[members] == number] for number in large]
        edges = [each[border[each]] for each in whole]
        tops = [float(np.median(height[chosen[each]])) for each in whole]
        group = _joined(edges, tops, origin[large], chosen, flat, height, shape[1])
        if group.max() == 0:
            continue
        owner = np.full(len(origin), -1)
        owner[large] = group
        group_of = owner[part[members]]
        known = group_of >= 0
        if not known.all():
            edge = members[known & border[members]]
            group_of[~known] = owner[part[edge]][cKDTree(flat[edge]).query(flat[members[~known]])[1]]
        result[members] = np.where(group_of == 0, label, fresh + group_of - 1)
        fresh += int(group.max())
    return result


def _fragments(picture: NDArray[np.bool_], inner: NDArray[np.bool_]) -> tuple[NDArray[np.int32], IntArray]:
    """Numbers (H, W) from 1, 0 for none, of what hangs together by more than a bridge; and, by number, the one of what
    hangs together at all. inner: the picture without its border.
    """
    whole, count = ndimage.label(picture)
    cores, found = ndimage.label(inner)
    origin = list(range(count + 1))
    large = np.flatnonzero(np.bincount(cores.reshape(-1), minlength=found + 1) >= LARGE)
    large = large[large > 0]
    home = np.zeros(found + 1, dtype=int)  # the fragment that each core is in
    home[cores[inner]] = whole[inner]
    boxes = ndimage.find_objects(whole)
    for fragment in np.flatnonzero(np.bincount(home[large], minlength=count + 1) > 1):
        box = boxes[fragment - 1]
        inside = whole[box] == fragment
        wanted = large[home[large] == fragment]
        nearest = ndimage.distance_transform_edt(
            ~np.isin(cores[box], wanted), return_distances=False, return_indices=True
        )
        piece = np.where(inside, cores[box][tuple(nearest)], 0)
        for number in wanted[1:]:
            mine = piece == number
            touching = ndimage.binary_dilation(mine) & inside & ~mine
            if np.count_nonzero(touching) < BRIDGE:
                whole[box][mine] = len(origin)
                origin.append(int(fragment))
    return whole, np.array(origin)


def _joined(
    edges: list[IntArray],
    tops: list[float],
    origin: IntArray,
    chosen: IntArray,
    flat: FloatArray,
    height: NDArray,
    columns: int,
) -> IntArray:
    """The number of the group (F,) that each fragment belongs to. edges: of each its border, as indices into `chosen`;
    tops: how high it is, m.
    """
    group = np.arange(len(edges))
    low = np.array([flat[each].min(axis=0) for each in edges]) - NEIGHBOURS
    high = np.array([flat[each].max(axis=0) for each in edges])
    trees = [cKDTree(flat[each]) for each in edges]
    for i in range(len(edges)):
        for j in range(i):
            far = (low[i] > high[j]).any() or (low[j] > high[i]).any()
            if far or origin[i] == origin[j] or group[i] == group[j]:
                continue
            # Where the two come nearest: is there table between most of the nearest pairs of pixels?
            distance, nearest = trees[j].query(flat[edges[i]])
            pairs = np.argsort(distance, kind="stable")[:NEAREST_PAIRS]
            lowest = _lowest_between(chosen[edges[i][pairs]], chosen[edges[j][nearest[pairs]]], height, columns)
            if 2 * np.count_nonzero(lowest < TABLE * min(tops[i], tops[j])) <= len(pairs):
                group[group == group[i]] = group[j]
    return np.unique(group, return_inverse=True)[1]


def _lowest_between(one: IntArray, other: IntArray, height: NDArray, columns: int) -> NDArray:
    """(P,) m: the lowest that is seen between each of the pixels `one` (P,) and that of `other`; NaN: nothing."""
    a, b = (np.stack(np.divmod(each, columns)) for each in (one, other))
    steps = max(2, int(np.abs(a - b).max()))
    between = np.arange(1, steps) / steps
    row, column = (np.rint(x[:, None] + (y - x)[:, None] * between).astype(int) for x, y in zip(a, b, strict=True))
    return np.fmin.reduce(height[row * columns + column], axis=1)
