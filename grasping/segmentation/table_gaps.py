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


def parts_by_table(pixels: IntArray, flat: FloatArray, height: NDArray, columns: int, least: int) -> IntArray:
    """Number (M,) of the part of a cluster that each of its pixels belongs to: the table is seen between the parts.

    pixels: of a frame of so many columns. flat: (M, 2) where they are on the table, m. height: (H·W,) of all pixels
    above it, m, NaN for none. least: pixels; smaller fragments stay with the nearest.
    """
    if len(pixels) < 2 * least:
        return np.zeros(len(pixels), dtype=np.int64)
    row, column = np.divmod(pixels, columns)
    at = row - row.min() + 1, column - column.min() + 1
    # A row and a column wider than the cluster, so that erosion sees where it ends.
    picture = np.zeros((at[0].max() + 2, at[1].max() + 2), dtype=bool)
    picture[at] = True
    inner = np.zeros_like(picture)
    inner[1:-1, 1:-1] = (
        picture[1:-1, 1:-1] & picture[:-2, 1:-1] & picture[2:, 1:-1] & picture[1:-1, :-2] & picture[1:-1, 2:]
    )
    fragments, origin = _fragments(picture, inner)
    if len(origin) == 2:
        return np.zeros(len(pixels), dtype=np.int64)
    fragment, border = fragments[at], ~inner[at]
    # Each fragment is looked at by its border. One whose border pixels all fell to its neighbours has none: a crumb.
    large = np.flatnonzero((np.bincount(fragment) >= least) & np.bincount(fragment, weights=border).astype(bool))
    if len(large) < 2:
        return np.zeros(len(pixels), dtype=np.int64)
    edges = [np.flatnonzero(border & (fragment == number)) for number in large]
    tops = [float(np.median(height[pixels[fragment == number]])) for number in large]
    owner = np.full(len(origin), -1)
    owner[large] = _joined(edges, tops, origin[large], pixels, flat, height, columns)
    group = owner[fragment]
    known = group >= 0
    if not known.all():
        edge = np.flatnonzero(known & border)
        group[~known] = group[edge][cKDTree(flat[edge]).query(flat[~known])[1]]
    return np.asarray(group, dtype=np.int64)


def _fragments(picture: NDArray[np.bool_], inner: NDArray[np.bool_]) -> tuple[NDArray[np.int32], IntArray]:
    """Numbers (H, W) from 1, 0 for none, of what hangs together by more than a bridge; and, by number, the one of what
    hangs together at all. inner: the picture without its border.
    """
    whole, count = ndimage.label(picture)
    cores, found = ndimage.label(inner)
    origin = list(range(count + 1))
    large = np.flatnonzero(np.bincount(cores.reshape(-1), minlength=found + 1) >= LARGE)
    large = large[large > 0]
    if len(large) < 2:
        return whole, np.array(origin)
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
        places = ndimage.find_objects(piece)
        for number in wanted[1:]:
            around = tuple(slice(max(each.start - 1, 0), each.stop + 1) for each in places[number - 1])
            mine = piece[around] == number
            touching = ndimage.binary_dilation(mine) & inside[around] & ~mine
            if np.count_nonzero(touching) < BRIDGE:
                whole[box][around][mine] = len(origin)
                origin.append(int(fragment))
    return whole, np.array(origin)


def _joined(
    edges: list[IntArray],
    tops: list[float],
    origin: IntArray,
    pixels: IntArray,
    flat: FloatArray,
    height: NDArray,
    columns: int,
) -> IntArray:
    """The number of the group (F,) that each fragment belongs to. edges: of each its border, as indices into `pixels`;
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
            lowest = _lowest_between(pixels[edges[i][pairs]], pixels[edges[j][nearest[pairs]]], height, columns)
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
