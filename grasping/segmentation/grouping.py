"""Which patches are of one object, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEAST_OBJECT = 40  # pixels of the working image; less goes to the neighbour that it is likest of one object with
MAY_BELONG = -1.5  # log odds of that


@dataclass(frozen=True)
class Grouping:
    """group: (n + 1,) the object, from 1 up, of each patch; 0 for patch 0, which is none. first, second: (P,) pairs of
    patches, odds: their log odds of being of one object, length: how much each counts, adjoin: whether they do.
    """

    group: IntArray
    first: IntArray
    second: IntArray
    odds: FloatArray
    length: FloatArray
    adjoin: NDArray[np.bool_]

    @cached_property
    def joins(self) -> FloatArray:
        """(G + 1,) for each object how sure, in [0, 1], its least sure patch belongs to the rest of it."""
        inside = self.group[self.first] == self.group[self.second]
        count = len(self.group)
        total, weight = np.zeros(count), np.zeros(count)
        for patch in (self.first[inside], self.second[inside]):
            total += np.bincount(patch, (self.odds * self.length)[inside], minlength=count)
            weight += np.bincount(patch, self.length[inside], minlength=count)
        sure = np.where(weight > 0, probability(total / np.maximum(weight, 1e-9)), 1.0)
        least = np.ones(int(self.group.max(initial=0)) + 1)
        np.minimum.at(least, self.group, sure)
        return least

    def without_specks(self, pixels: FloatArray) -> Grouping:
        """The groups, but what is too small is given to a neighbour that it may belong to. pixels: of each patch."""
        sizes = np.bincount(self.group, pixels, minlength=int(self.group.max(initial=0)) + 1)
        return self.given_away(np.flatnonzero(sizes < LEAST_OBJECT), MAY_BELONG)

    def given_away(self, groups: IntArray, least: float) -> Grouping:
        """The same, but each of these groups is given to the neighbour that it is likest of one object with, where the
        log odds of that are at least so much.
        """
        group = self.group.copy()
        one, other = group[self.first], group[self.second]
        for given in groups:
            beside = ((one == given) ^ (other == given)) & (given > 0) & self.adjoin
            if not beside.any():
                continue
            neighbour = np.where(one == given, other, one)[beside]
            weight = np.bincount(neighbour, self.length[beside])
            total = np.bincount(neighbour, (self.odds * self.length)[beside])
            mean = np.where(weight > 0, total / np.maximum(weight, 1e-9), -np.inf)
            best = int(mean.argmax())
            if mean[best] > least:
                group[group == given] = best
                one, other = group[self.first], group[self.second]
        return replace(self, group=group)

    @cached_property
    def between(self) -> tuple[IntArray, IntArray, FloatArray]:
        """(K,) each: neighbouring objects, the lower and the higher one, and how sure, in [0, 1], they are two."""
        one, other = self.group[self.first], self.group[self.second]
        apart = one != other
        low, high = np.minimum(one, other)[apart], np.maximum(one, other)[apart]
        count = int(self.group.max(initial=0)) + 1
        pairs, inverse = np.unique(low * count + high, return_inverse=True)
        total = np.bincount(inverse, (self.odds * self.length)[apart], minlength=len(pairs))
        weight = np.bincount(inverse, self.length[apart], minlength=len(pairs))
        return pairs // count, pairs % count, 1.0 - probability(total / np.maximum(weight, 1e-9))

    @cached_property
    def cuts(self) -> dict[tuple[int, int], float]:
        """For pairs of neighbouring objects, first < second, how sure, in [0, 1], they are two."""
        low, high, sure = self.between
        return dict(zip(zip(low.tolist(), high.tolist(), strict=True), sure.tolist(), strict=True))


def probability(odds: FloatArray) -> FloatArray:
    return np.asarray(1.0 / (1.0 + np.exp(-odds)))
