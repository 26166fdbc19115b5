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
TABLE = 0.4  # of the lower fragment's height: what lies lower between them is table and no noise on one thing


def split_by_table(
    labels: IntArray, chosen: IntArray, flat: FloatArray, height: NDArray, shape: tuple[int, int], least: int
) -> IntArray:
    """Labels (C,) anew: clusters between whose parts the table is seen fall into these parts.

    labels: of the points `chosen` (C,), which are pixels of a frame (H, W), −1 for none. flat: (C, 2) where they are on
    the table, m. height: (H·W,) of all pixels above it, m, NaN for none. least: pixels; smaller fragments stay with the
    nearest.
    """
    parts, origin = _fragments(chosen[labels >= 0], shape)
    part = parts.reshape(-1)[chosen]
    sizes = np.bincount(part, minlength=len(origin))
    result = labels.copy()
    fresh = int(labels.max(initial=-1)) + 1
    for label in np.unique(labels[labels >= 0]):
        members = np.flatnonzero(labels == label)
        here = np.unique(part[members])
        large = here[sizes[here] >= least]
        if len(large) < 2:
            continue
        fragments = [members[part[members] == number] for number in large]
        group = _joined(fragments, origin[large], chosen, flat, height, shape[1])
        if group.max() == 0:
            continue
        owner = np.full(len(origin), -1)
        owner[large] = group
        group_of = owner[part[members]]
        known = group_of >= 0
        group_of[~known] = group_of[known][cKDTree(flat[members[known]]).query(flat[members[~known]])[1]]
        result[members] = np.where(group_of == 0, label, fresh + group_of - 1)
        fresh += int(group.max())
    return result


def _fragments(pixels: IntArray, shape: tuple[int, int]) -> tuple[NDArray[np.int32], IntArray]:
    """A picture (H, W) of numbers from 1, 0 for none, of what hangs together by more than a bridge; and, by number, the
    one of what hangs together at all.
    """
    picture = np.zeros(shape, dtype=bool)
    picture.reshape(-1)[pixels] = True
    whole, count = ndimage.label(picture)
    cores, found = ndimage.label(ndimage.binary_erosion(picture))
    large = np.flatnonzero(np.bincount(cores.reshape(-1), minlength=found + 1) >= LARGE)
    large = large[large > 0]
    home = np.zeros(found + 1, dtype=int)  # the fragment that each core is in
    home[cores[cores > 0]] = whole[cores > 0]
    origin = list(range(count + 1))
    crowded = np.flatnonzero(np.bincount(home[large], minlength=count + 1) > 1)
    for fragment in crowded:
        inside = whole == fragment
        wanted = large[home[large] == fragment]
        nearest = ndimage.distance_transform_edt(~np.isin(cores, wanted), return_distances=False, return_indices=True)
        piece = np.where(inside, cores[tuple(nearest)], 0)
        for number in wanted[1:]:
            mine = piece == number
            touching = ndimage.binary_dilation(mine) & inside & ~mine
            if np.count_nonzero(touching) < BRIDGE:
                whole[mine] = len(origin)
                origin.append(int(fragment))
    return whole, np.array(origin)


def _joined(
    fragments: list[IntArray], origin: IntArray, chosen: IntArray, flat: FloatArray, height: NDArray, columns: int
) -> IntArray:
    """The number of the group (F,) that each fragment, indices into `chosen`, belongs to."""
    group = np.arange(len(fragments))
    trees = [cKDTree(flat[each]) for each in fragments]
    for i in range(len(fragments)):
        for j in range(i):
            if origin[i] == origin[j] or group[i] == group[j]:
                continue
            if not _apart(fragments[i], fragments[j], trees[j], chosen, flat, height, columns):
                group[group == group[i]] = group[j]
    return np.unique(group, return_inverse=True)[1]


def _apart(
    one: IntArray,
    other: IntArray,
    tree: cKDTree,
    chosen: IntArray,
    flat: FloatArray,
    height: NDArray,
    columns: int,
) -> bool:
    """Whether the table is seen between two fragments where they come nearest."""
    distance, nearest = tree.query(flat[one])
    pairs = np.argsort(distance, kind="stable")[:NEAREST_PAIRS]
    a, b = (np.stack(np.divmod(chosen[each], columns)) for each in (one[pairs], other[nearest[pairs]]))
    steps = max(2, int(np.abs(a - b).max()))
    between = np.arange(1, steps) / steps
    row, column = (np.rint(x[:, None] + (y - x)[:, None] * between).astype(int) for x, y in zip(a, b, strict=True))
    lowest = np.fmin.reduce(height[row * columns + column], axis=1)
    lower = min(float(np.median(height[chosen[each]])) for each in (one, other))
    return 2 * int(np.count_nonzero(lowest < TABLE * lower)) > len(pairs)
