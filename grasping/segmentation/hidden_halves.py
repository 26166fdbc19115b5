"""Join the halves of a thing on either side of what hides its middle.

Each half has some faces, and each face goes on in one of the other half's at most: that its front is not in one
surface with the other's top says nothing. Adding up all pairs, as is right for patches that adjoin, would count that
against it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.grouping import Grouping

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RATHER_ONE = 0.3  # mean log odds of the faces that go on in each other
SURELY_TWO = -0.5  # mean log odds along a common border, below which halves are two things
MOSTLY = 0.5  # of either half's pixels, in faces that may go on in the other: in a heap, some always do by chance


def join_halves(grouping: Grouping, pixels: FloatArray) -> Grouping:
    """The groups, but pairs of them are joined whose patches, each with its likeliest partner in the other, are on
    balance of one object; the surest first. pixels: (n + 1,) of each patch.
    """
    group = grouping.group.copy()
    far = np.flatnonzero(~grouping.adjoin)
    while (halves := _surest(grouping, group, far, pixels)) is not None:
        group[group == halves[1]] = halves[0]
    return replace(grouping, group=group)


def _surest(grouping: Grouping, group: IntArray, far: IntArray, pixels: FloatArray) -> tuple[int, int] | None:
    one, other = group[grouping.first], group[grouping.second]
    apart = far[one[far] != other[far]]
    if not (grouping.odds[apart] > RATHER_ONE).any():
        return None
    pairs: dict[tuple[int, int], list[int]] = {}
    for pair in apart[np.argsort(-grouping.odds[apart], kind="stable")].tolist():
        i, j = int(one[pair]), int(other[pair])
        pairs.setdefault((min(i, j), max(i, j)), []).append(pair)
    sizes = np.bincount(group, pixels)
    best, halves = RATHER_ONE, None
    for (i, j), between in pairs.items():
        sure, matched = _agreement(grouping, between, pixels)
        if sure <= best or any(pixels[matched[group[matched] == k]].sum() < MOSTLY * sizes[k] for k in (i, j)):
            continue
        border = np.flatnonzero(grouping.adjoin & (((one == i) & (other == j)) | ((one == j) & (other == i))))
        length = grouping.length[border]
        if len(border) and (grouping.odds[border] * length).sum() < SURELY_TWO * length.sum():
            continue
        best, halves = sure, (i, j)
    return halves


def _agreement(grouping: Grouping, pairs: list[int], pixels: FloatArray) -> tuple[float, IntArray]:
    """Mean log odds of pairs, the likeliest first, in which no patch is twice, weighted by the smaller one's size; and
    the patches.
    """
    used: list[int] = []
    total = weights = 0.0
    for pair in pairs:
        i, j = int(grouping.first[pair]), int(grouping.second[pair])
        if i in used or j in used:
            continue
        used += [i, j]
        weight = float(np.sqrt(min(pixels[i], pixels[j])))
        total += weight * float(grouping.odds[pair])
        weights += weight
    return total / max(weights, 1e-9), np.array(used)
