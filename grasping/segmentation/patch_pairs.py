"""Which patches may be of one object: those that adjoin, and those with something nearer or nothing measured between.

A study of touching and stacked things (see docs) found that what adjoins tells most, and that two patches on either
side of a third that hides what lies between need a judgement of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.pieces import label_pieces

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Labels = NDArray[np.int32]

REACH = 5  # pixels: a border may be as wide where nothing is known in between
IN_FRONT = 0.008  # 1/m by which one patch hides another at their border
LEAST_BORDER = 4  # pixel pairs that show which of two is in front
MOSTLY = 0.5  # of a border on which two surfaces go over into each other
LEAST_AT_HOLE = 3  # pixels of a patch at a hole
LARGE_HOLE = 0.05  # of the image: not a hole of one object


@dataclass(frozen=True)
class Borders:
    """Pixel pairs (B,) across the borders of patches, sorted by pair of patches.

    inner, outer: flattened pixels in the patch with the lower and with the higher number; steps: pixels between them,
    1 where they adjoin; along_row: whether they lie in one row; forward: +1 where outer comes after inner, else −1.
    start: (P + 1,) where each pair's begin; first, second: (P,) the patches, first < second; adjoining: (P,) how many
    of a pair's pixels adjoin.
    """

    inner: IntArray
    outer: IntArray
    steps: IntArray
    along_row: NDArray[np.bool_]
    forward: IntArray
    start: IntArray
    first: IntArray
    second: IntArray
    adjoining: IntArray

    def of_parts(self, part: IntArray) -> Borders:
        """Those between parts that patches make together. part: (n + 1,) each patch's."""
        sizes = np.diff(self.start)
        one, other = np.repeat(part[self.first], sizes), np.repeat(part[self.second], sizes)
        between = np.flatnonzero(one != other)
        inner, outer = self.inner[between], self.outer[between]
        return _sorted(
            one[between], other[between], inner, outer, self.steps[between], self.along_row[between], int(part.max())
        )


def borders(labels: Labels, count: int, unknown: NDArray[np.bool_]) -> Borders:
    """Find where patches adjoin, or have only a few pixels that are `unknown` (h, w) between them."""
    flat = labels.ravel()
    found: list[tuple[IntArray, IntArray, IntArray, NDArray[np.bool_]]] = []
    along_row, down_column = steps_to_borders(labels, unknown).reshape(2, -1)
    for far, step in ((along_row, 1), (down_column, labels.shape[1])):
        at = np.flatnonzero(far > 0)
        steps = far[at].astype(np.int64)
        found.append((at, at + steps * step, steps, np.full(len(at), far is along_row)))
    one, other, steps_, rows = (np.concatenate(part) for part in zip(*found, strict=True))
    return _sorted(flat[one].astype(np.int64), flat[other].astype(np.int64), one, other, steps_, rows, count)


def _sorted(
    patch: IntArray,
    other_patch: IntArray,
    pixel: IntArray,
    other_pixel: IntArray,
    steps: IntArray,
    along_row: NDArray[np.bool_],
    count: int,
) -> Borders:
    """The borders of pixel pairs (B,) of two patches, of which there are so many."""
    swap = patch > other_patch
    inner, outer = np.where(swap, other_pixel, pixel), np.where(swap, pixel, other_pixel)
    key = np.minimum(patch, other_patch) * (count + 1) + np.maximum(patch, other_patch)
    order = np.argsort(key.astype(np.min_scalar_type((count + 1) ** 2)), kind="stable")  # numbers of 16 bits: by radix
    key = key[order]
    start = np.flatnonzero(np.diff(key, prepend=-1))
    pairs = key[start]
    inner, outer, steps = inner[order], outer[order], steps[order]
    return Borders(
        inner=inner,
        outer=outer,
        steps=steps,
        along_row=along_row[order],
        forward=np.sign(outer - inner),
        start=np.append(start, len(order)),
        first=pairs // (count + 1),
        second=pairs % (count + 1),
        adjoining=np.add.reduceat(steps == 1, start, dtype=np.int64) if len(start) else start,
    )


def steps_to_borders(labels: Labels, unknown: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """(2, h, w): how many pixels it is to the next patch along the row and down the column; 0 where it is too far."""
    if kernels.compiled is None:
        return steps_to_borders_reference(labels, unknown)
    steps = np.empty((2, *labels.shape), dtype=np.uint8)
    kernels.compiled.steps_to_borders(labels, unknown, steps)
    return steps


def steps_to_borders_reference(labels: Labels, unknown: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """`steps_to_borders` in NumPy."""
    h, w = labels.shape
    flat, is_unknown = labels.ravel(), unknown.ravel()
    labelled = np.flatnonzero(flat)
    steps = np.zeros((2, h * w), dtype=np.uint8)
    row, column = np.divmod(labelled, w)
    for found, step, room in zip(steps, (1, w), (w - 1 - column, h - 1 - row), strict=True):
        at = labelled
        for number in range(1, REACH + 1):
            at, room = at[room >= number], room[room >= number]
            there = at + number * step
            found[at[(flat[there] > 0) & (flat[there] != flat[at])]] = number
            onward = (flat[there] == 0) & is_unknown[there]
            at, room = at[onward], room[onward]
    return steps.reshape(2, h, w)


def hidden_pairs(
    found: Borders,
    first_in_front: IntArray,
    second_in_front: IntArray,
    level: NDArray[np.floating],
    holes: Sequence[PatchesAtHole],
) -> set[tuple[int, int]]:
    """Pairs that do not adjoin, but lie behind one nearer patch, or behind two that go over into each other.

    *_in_front: (P,) pixel pairs that show it. level: (P,) the share of a border on which neither is in front. holes: by
    those, too, one patch may lie behind another, where the sensor measured nothing in the nearer one's shadow.
    """
    behind: dict[int, set[int]] = {}
    for front, back, shown in (
        (found.first, found.second, first_in_front),
        (found.second, found.first, second_in_front),
    ):
        for number in np.flatnonzero(shown >= LEAST_BORDER):
            behind.setdefault(int(front[number]), set()).add(int(back[number]))
    pairs: set[tuple[int, int]] = set()
    for number in np.flatnonzero(level > MOSTLY):
        one, other = int(found.first[number]), int(found.second[number])
        for i in behind.get(one, ()):
            pairs |= {(min(i, j), max(i, j)) for j in behind.get(other, ()) if i != j}
    for hole in holes:
        for one, near in zip(hole.patches, hole.inverse_depth, strict=True):
            for other, far in zip(hole.patches, hole.inverse_depth, strict=True):
                if near - far > IN_FRONT:
                    behind.setdefault(one, set()).add(other)
    pairs |= {pair for patches in behind.values() for pair in combinations(sorted(patches), 2)}
    return pairs - _as_set(found)


@dataclass(frozen=True)
class PatchesAtHole:
    """The patches that reach to one hole in the depth, rising, and each one's mean inverse depth there, 1/m."""

    patches: list[int]
    inverse_depth: list[float]


@dataclass(frozen=True)
class HoleRims:
    """Pixels (R,) beside each hole in the depth, a hole's pixels one after the other: hole, its number from 1 up, and
    beside, flattened. Holes that are too large to be one object's are left out.
    """

    hole: IntArray
    beside: IntArray


def rims_of_holes(inverse_depth: Float32Array) -> HoleRims:
    """Of an image (h, w), 1/m and 0 in holes."""
    h, w = inverse_depth.shape
    nothing = inverse_depth <= 0
    holes, count = label_pieces(nothing)
    empty = np.flatnonzero(nothing)
    hole = holes.ravel().take(empty)
    small = np.flatnonzero((np.bincount(hole, minlength=count + 1) < LARGE_HOLE * inverse_depth.size)[hole])
    empty, hole = empty[small], hole[small].astype(np.int64)
    column, found = empty - empty // w * w, []
    for step, there in ((-1, column > 0), (1, column < w - 1), (-w, empty >= w), (w, empty < (h - 1) * w)):
        at = np.flatnonzero(there)
        at = at[~nothing.ravel()[empty[at] + step]]
        found.append((hole[at], empty[at] + step))
    return HoleRims(*(np.concatenate(part) for part in zip(*found, strict=True)))


def patches_at_holes(labels: Labels, inverse_depth: Float32Array, rims: HoleRims) -> list[PatchesAtHole]:
    """What reaches to each hole of an image (h, w), 1/m and 0 in holes."""
    patch = labels.ravel().take(rims.beside)
    used = np.flatnonzero(patch)
    if not len(used):
        return []
    patches = int(patch.max()) + 1
    key = rims.hole[used] * patches + patch[used]
    pixels = np.bincount(key)
    total = np.bincount(key, inverse_depth.ravel().take(rims.beside[used]))
    shown = np.flatnonzero(pixels >= LEAST_AT_HOLE)
    hole, patch = np.divmod(shown, patches)
    mean = total[shown] / pixels[shown]
    first = np.flatnonzero(np.diff(hole, prepend=-1))
    ends = [*first[1:].tolist(), len(shown)]
    patch_, mean_ = patch.tolist(), mean.tolist()
    return (
        [PatchesAtHole(patch_[i:j], mean_[i:j]) for i, j in zip(first.tolist(), ends, strict=True)]
        if len(first)
        else []
    )


def pairs_at_holes(holes: Sequence[PatchesAtHole], found: Borders) -> set[tuple[int, int]]:
    """Pairs that do not adjoin, but both reach to one hole in the depth."""
    return {pair for hole in holes for pair in combinations(hole.patches, 2)} - _as_set(found)


def _as_set(found: Borders) -> set[tuple[int, int]]:
    return set(zip(found.first.tolist(), found.second.tolist(), strict=True))
