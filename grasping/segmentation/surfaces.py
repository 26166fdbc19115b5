"""Tell things apart that touch, lean, hide and lie on each other: surfaces, and which of them are of one object.

An image is cut into patches of smooth surface; trees, trained on simulated scenes, say of each pair of patches how sure
they are of one object; and the patches are grouped by all of that together.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.boosted_trees import Relations, read_relations
from grasping.segmentation.correlation_clustering import cluster
from grasping.segmentation.pair_features import AT_BORDER, NAMES, OF_BOTH, border_features, shape_features
from grasping.segmentation.patch_measures import PatchMeasures, measure_patches
from grasping.segmentation.patch_pairs import borders, hidden_pairs, pairs_at_holes
from grasping.segmentation.surface_fits import fit_surfaces
from grasping.segmentation.surface_patches import cut_into_patches
from grasping.segmentation.table_relief import Relief, relief
from grasping.segmentation.working_image import WorkingImage

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Labels = NDArray[np.int32]

TRAINED = Path(__file__).with_name("relations.npz")
FAR_LENGTH = 6.0  # pixels of border that a pair which does not adjoin counts like
MOST_SURE = 9.0  # log odds: no single pair outvotes all others


class Surfaces:
    """The patches of an image, what pairs of them there are, and what is known of each pair."""

    def __init__(self, image: WorkingImage, plane: FloatArray | None, max_height: float = 0.45) -> None:
        self.image = image
        self.positions = image.positions()
        measured = image.inverse_depth > 0
        up = None if plane is None else plane[:3]
        self.relief: Relief | None = None
        if plane is None:
            stands_out = measured
            height = np.full(image.shape, np.nan, dtype=np.float32)
        else:
            n, d = plane[:3].astype(np.float32), np.float32(plane[3] + plane[:3] @ image.viewpoint)
            height = self.positions[..., 0] * n[0] + self.positions[..., 1] * n[1] + self.positions[..., 2] * n[2] + d
            self.relief = relief(image, plane, height)
            stands_out = self.relief.stands_out & (height <= max_height)
        asked = np.flatnonzero(stands_out)
        fits = fit_surfaces(image, asked)
        self.fitted = fits.inverse_depth
        self.labels, self.count, edge = cut_into_patches(fits, self.positions, asked)
        table = measured & ~(stands_out if self.relief is None else self.relief.stands_out)
        self.borders = borders(self.labels, self.count, (self.labels == 0) & ~table)
        self.measures: PatchMeasures = measure_patches(
            image, fits, self.positions, self.labels, self.count, edge, height, table
        )
        at_border, first_in_front, second_in_front = border_features(
            self.borders, fits, self.positions, self.labels, height, up, self.measures
        )
        level = at_border[:, AT_BORDER.index("level")]
        hidden = hidden_pairs(self.borders, first_in_front, second_in_front, level)
        at_hole = pairs_at_holes(self.labels, measured, self.borders)
        far = sorted(hidden | at_hole)
        self.far_first = np.array([i for i, _ in far], dtype=np.int64)
        self.far_second = np.array([j for _, j in far], dtype=np.int64)
        nothing = np.zeros(len(self.borders.first), dtype=bool)
        near = shape_features(self.borders.first, self.borders.second, nothing, nothing, self.measures, up)
        self.near_features = np.concatenate([at_border, near], axis=1)
        self.far_features = shape_features(
            self.far_first,
            self.far_second,
            np.array([pair in hidden for pair in far], dtype=bool),
            np.array([pair in at_hole for pair in far], dtype=bool),
            self.measures,
            up,
        )

    def group(self, relations: Relations) -> Grouping:
        """Say which patches are of one object."""
        near = np.clip(relations.near.log_odds(self.near_features), -MOST_SURE, MOST_SURE)
        far = np.clip(relations.far.log_odds(self.far_features), -MOST_SURE, MOST_SURE)
        first = np.concatenate([self.borders.first, self.far_first])
        second = np.concatenate([self.borders.second, self.far_second])
        odds = np.concatenate([near, far])
        length = np.sqrt(np.concatenate([np.diff(self.borders.start), np.full(len(far), FAR_LENGTH)]))
        # Patch 0 is no patch: alone it is cluster 0, and objects count from 1.
        adjoin = np.arange(len(first)) < len(near)
        return Grouping(cluster(self.count + 1, first, second, odds * length), first, second, odds, length, adjoin)


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
        sure = np.where(weight > 0, _probability(total / np.maximum(weight, 1e-9)), 1.0)
        least = np.ones(int(self.group.max(initial=0)) + 1)
        np.minimum.at(least, self.group, sure)
        return least

    def cuts(self) -> dict[tuple[int, int], float]:
        """For pairs of neighbouring objects, first < second, how sure, in [0, 1], they are two."""
        one, other = self.group[self.first], self.group[self.second]
        apart = one != other
        low, high = np.minimum(one, other)[apart], np.maximum(one, other)[apart]
        pairs, inverse = np.unique(np.stack([low, high], axis=1), axis=0, return_inverse=True)
        inverse = inverse.reshape(-1)
        total = np.bincount(inverse, (self.odds * self.length)[apart], minlength=len(pairs))
        weight = np.bincount(inverse, self.length[apart], minlength=len(pairs))
        sure = 1.0 - _probability(total / np.maximum(weight, 1e-9))
        return {(int(i), int(j)): float(value) for (i, j), value in zip(pairs, sure, strict=True)}


def _probability(odds: FloatArray) -> FloatArray:
    return np.asarray(1.0 / (1.0 + np.exp(-odds)))


def trained_relations(path: Path | None = None) -> Relations:
    """The trees of a file, by default of the one that is part of the package."""
    return read_relations(path or TRAINED, NAMES, tuple(OF_BOTH))


__all__ = ["AT_BORDER", "NAMES", "OF_BOTH", "Grouping", "Surfaces", "trained_relations"]
