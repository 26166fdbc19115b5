"""Which patches may be of one object: those that adjoin, and those with something nearer or nothing measured between.

A study of touching and stacked things (see docs) found that what adjoins tells most, and that two patches on either
side of a third that hides what lies between need a judgement of their own.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

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
    start: (P + 1,) where each pair's begin; first, second: (P,) the patches, first < second.
    """

    inner: IntArray
    outer: IntArray
    steps: IntArray
    along_row: NDArray[np.bool_]
    forward: IntArray
    start: IntArray
    first: IntArray
    second: IntArray


def borders(labels: Labels, count: int, unknown: NDArray[np.bool_]) -> Borders:
    """Find where patches adjoin, or have only a few pixels that are `unknown` (h, w) between them."""
    h, w = labels.shape
    flat, is_unknown = labels.ravel(), unknown.ravel()
    labelled = np.flatnonzero(flat)
    found: list[tuple[IntArray, IntArray, IntArray, NDArray[np.bool_]]] = []
    for along_row in (True, False):
        step = 1 if along_row else w
        room = (w - 1 - labelled % w) if along_row else (h - 1 - labelled // w)
        at = labelled
        for steps in range(1, REACH + 1):
            at, room = at[room >= steps], room[room >= steps]
            there = at + steps * step
            border = (flat[there] > 0) & (flat[there] != flat[at])
            number = int(np.count_nonzero(border))
            found.append((at[border], there[border], np.full(number, steps), np.full(number, along_row)))
            onward = (flat[there] == 0) & is_unknown[there]
            at, room = at[onward], room[onward]
    one, other, steps_, rows = (np.concatenate(part) for part in zip(*found, strict=True))
    swap = flat[one] > flat[other]
    inner, outer = np.where(swap, other, one), np.where(swap, one, other)
    key = flat[inner].astype(np.int64) * (count + 1) + flat[outer]
    order = np.argsort(key, kind="stable")
    pairs, start = np.unique(key[order], return_index=True)
    return Borders(
        inner=inner[order],
        outer=outer[order],
        steps=steps_[order],
        along_row=rows[order],
        forward=np.where(swap, -1, 1)[order],
        start=np.append(start, len(order)),
        first=pairs // (count + 1),
        second=pairs % (count + 1),
    )


def hidden_pairs(
    found: Borders, first_in_front: IntArray, second_in_front: IntArray, level: NDArray[np.floating]
) -> set[tuple[int, int]]:
    """Pairs that do not adjoin, but lie behind one nearer patch, or behind two that go over into each other.

    *_in_front: (P,) pixel pairs that show it. level: (P,) the share of a border on which neither is in front.
    """
    behind: dict[int, set[int]] = {}
    for front, back, shown in (
        (found.first, found.second, first_in_front),
        (found.second, found.first, second_in_front),
    ):
        for number in np.flatnonzero(shown >= LEAST_BORDER):
            behind.setdefault(int(front[number]), set()).add(int(back[number]))
    adjoin = _as_set(found)
    pairs = {pair for patches in behind.values() for pair in combinations(sorted(patches), 2)}
    for number in np.flatnonzero(level > MOSTLY):
        one, other = int(found.first[number]), int(found.second[number])
        for i in behind.get(one, ()):
            pairs |= {(min(i, j), max(i, j)) for j in behind.get(other, ()) if i != j}
    return pairs - adjoin


def pairs_at_holes(labels: Labels, measured: NDArray[np.bool_], found: Borders) -> set[tuple[int, int]]:
    """Pairs that do not adjoin, but both reach to one hole in the depth."""
    holes, count = ndimage.label(~measured)
    if not count:
        return set()
    beside = []
    for own, hole in (
        (labels[:, :-1], holes[:, 1:]),
        (labels[:, 1:], holes[:, :-1]),
        (labels[:-1], holes[1:]),
        (labels[1:], holes[:-1]),
    ):
        at = (own > 0) & (hole > 0)
        beside.append(hole[at].astype(np.int64) * (labels.max() + 1) + own[at])
    key, pixels = np.unique(np.concatenate(beside), return_counts=True)
    key = key[pixels >= LEAST_AT_HOLE]
    sizes = np.bincount(holes.ravel(), minlength=count + 1)
    at_hole: dict[int, list[int]] = {}
    for hole, patch in zip((key // (labels.max() + 1)).tolist(), (key % (labels.max() + 1)).tolist(), strict=True):
        if sizes[hole] < LARGE_HOLE * labels.size:
            at_hole.setdefault(hole, []).append(patch)
    return {pair for patches in at_hole.values() for pair in combinations(sorted(patches), 2)} - _as_set(found)


def _as_set(found: Borders) -> set[tuple[int, int]]:
    return set(zip(found.first.tolist(), found.second.tolist(), strict=True))
