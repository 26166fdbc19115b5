"""Tell things apart that touch, lean, hide and lie on each other: surfaces, and which of them are of one object.

An image is cut into patches of smooth surface; trees, trained on simulated scenes, say of each pair of patches how sure
they are of one object; and the patches are grouped by all of that together. What is grouped so can be looked at once
more as if it were patches (`merged`).
"""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.boosted_trees import BoostedTrees
from grasping.segmentation.correlation_clustering import cluster
from grasping.segmentation.grouping import Grouping
from grasping.segmentation.pair_features import AT_BORDER, border_features, shape_features, stand_apart
from grasping.segmentation.patch_measures import PatchSums, add_up_patches
from grasping.segmentation.patch_pairs import borders, hidden_pairs, pairs_at_holes, patches_at_holes, rims_of_holes
from grasping.segmentation.surface_fits import fit_surfaces
from grasping.segmentation.surface_patches import cut_into_patches
from grasping.segmentation.table_relief import Relief, heights_over, relief
from grasping.segmentation.working_image import WorkingImage
from grasping.segmentation.wrinkles import wrinkles

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Labels = NDArray[np.int32]

FAR_LENGTH = 6.0  # pixels of border that a pair which does not adjoin counts like
APART = -12.0  # log odds of two that stand one behind the other: surer than the trees ever are
MOST_SURE = 9.0  # log odds: no single pair outvotes all others


class Surfaces:
    """The patches of an image, what pairs of them there are, and what is known of each pair."""

    def __init__(self, image: WorkingImage, plane: FloatArray | None, max_height: float = 0.45) -> None:
        self.image = image
        self.positions = image.positions()
        measured = image.inverse_depth > 0
        self.up = None if plane is None else plane[:3]
        self.relief: Relief | None = None
        if plane is None:
            stands_out = measured
            height = np.full(image.shape, np.nan, dtype=np.float32)
        else:
            level, height = heights_over(image, plane)
            self.relief = relief(image, level, height)
            stands_out = self.relief.stands_out & (height <= max_height)
        asked = np.flatnonzero(stands_out)
        self.fits = fits = fit_surfaces(image, asked)
        self.labels, self.count, self.edge = cut_into_patches(fits, self.positions, asked)
        self.height = height
        self.table = table = measured & ~(stands_out if self.relief is None else self.relief.stands_out)
        if plane is not None and self.relief is not None:
            camera = float(plane[:3] @ image.viewpoint + plane[3])
            kept = ~wrinkles(self.labels, self.count, self.relief, image.inverse_depth, camera)
            if not kept.all():
                number = np.where(kept, np.cumsum(kept) - 1, 0).astype(np.int32).take(self.labels)
                table |= (self.labels > 0) & (number == 0)
                self.labels, self.count = number, int(np.count_nonzero(kept)) - 1
        self._rims = rims_of_holes(image.inverse_depth)
        self.borders = borders(self.labels, self.count, (self.labels == 0) & ~table)
        self.sums = add_up_patches(
            image,
            fits,
            self.positions,
            self.labels,
            self.count,
            self.edge,
            height,
            table,
            height if self.relief is None else self.relief.above,
            np.nan if self.relief is None else self.relief.noise,
        )
        self._describe_pairs()

    def merged(self, part: IntArray) -> Surfaces:
        """The same image with parts, which patches make together, as patches. part: (n + 1,) each patch's, 0 for patch
        0, and all from 1 up.
        """
        merged = copy(self)
        merged.labels, merged.count = part.astype(np.int32).take(self.labels), int(part.max())
        merged.borders = self.borders.of_parts(part)
        merged.sums = self.sums.of_groups(part, self.borders.first, self.borders.second, self.borders.adjoining)
        merged._describe_pairs()
        # Of parts the border is longer, and hides what stands behind which: two that stand apart somewhere do so.
        low, high = (np.sort(part[np.stack([self.borders.first, self.borders.second])], axis=0)[:, self.apart]).tolist()
        apart = set(zip(low, high, strict=True))
        pairs = zip(merged.borders.first.tolist(), merged.borders.second.tolist(), strict=True)
        merged.apart = merged.apart | np.array([pair in apart for pair in pairs], dtype=bool)
        return merged

    def _describe_pairs(self) -> None:
        at_border, in_front = border_features(
            self.borders, self.fits, self.positions, self.labels, self.height, self.up, self.sums
        )
        level = at_border[:, AT_BORDER.index("level")]
        holes = patches_at_holes(self.labels, self.image.inverse_depth, self._rims)
        hidden = hidden_pairs(self.borders, in_front[0], in_front[1], level, holes)
        at_hole = pairs_at_holes(holes, self.borders)
        far = sorted(hidden | at_hole)
        self.far_first = np.array([i for i, _ in far], dtype=np.int64)
        self.far_second = np.array([j for _, j in far], dtype=np.int64)
        nothing = [False] * len(self.borders.first)
        of_both = shape_features(
            np.concatenate([self.borders.first, self.far_first]),
            np.concatenate([self.borders.second, self.far_second]),
            np.array(nothing + [pair in hidden for pair in far], dtype=bool),
            np.array(nothing + [pair in at_hole for pair in far], dtype=bool),
            self.sums,
            self.up,
        )
        self.near_features = np.concatenate([at_border, of_both[: len(nothing)]], axis=1)
        self.far_features = of_both[len(nothing) :]
        self.apart = stand_apart(self.near_features)

    def sums_of_groups(self, grouping: Grouping) -> PatchSums:
        """What is added up over groups of patches."""
        adjoining = np.zeros(len(grouping.first), dtype=np.int64)
        adjoining[: len(self.borders.first)] = self.borders.adjoining
        return self.sums.of_groups(grouping.group, grouping.first, grouping.second, adjoining)

    def group(self, of_adjoining: BoostedTrees, of_others: BoostedTrees, whole_rather: float) -> Grouping:
        """Say which patches are of one object, by trees for pairs that adjoin and for those that do not. whole_rather:
        log odds by which any two that adjoin rather are.
        """
        near = np.clip(of_adjoining.log_odds(self.near_features) + whole_rather, -MOST_SURE, MOST_SURE)
        near = np.where(self.apart, np.minimum(near, APART), near)
        far = np.clip(of_others.log_odds(self.far_features), -MOST_SURE, MOST_SURE)
        first = np.concatenate([self.borders.first, self.far_first])
        second = np.concatenate([self.borders.second, self.far_second])
        odds = np.concatenate([near, far])
        length = np.sqrt(np.concatenate([np.diff(self.borders.start), np.full(len(far), FAR_LENGTH)]))
        # Patch 0 is no patch: alone it is cluster 0, and objects count from 1.
        adjoin = np.arange(len(first)) < len(near)
        return Grouping(cluster(self.count + 1, first, second, odds * length), first, second, odds, length, adjoin)
