"""Objects of a frame whose lines of sight are known: told apart by their surfaces, also where they touch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.segmentation.boosted_trees import Relations
from grasping.segmentation.group_features import OF_GROUP, group_features
from grasping.segmentation.grouping import Grouping, probability
from grasping.segmentation.hidden_halves import join_halves
from grasping.segmentation.surfaces import Surfaces
from grasping.segmentation.working_image import ALIKE, WorkingImage

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Labels = NDArray[np.int32]

WHOLE_RATHER = 0.5  # log odds: real tables are less of a heap than the scenes that the trees were trained on
PARTS_RATHER = -1.5  # log odds at most of the first grouping: what it joins wrongly nothing parts again
SCRAP, SURELY_NO_WHOLE, LEAST_ODDS = 300, 0.3, -4.0  # pixels, probability, log odds of being of its neighbour
STEP, STEPS = 0.008, 8  # m between points of one object, and how often one is given on
FLYING = 0.03  # 1/m from all pixels around: a point in the air


@dataclass(frozen=True)
class SurfaceGroups:
    """number: (N,) each point's group, from 1 up, 0 for none. above_table: (N,) 1/m by which a point is nearer than the
    table as the sensor bends it, and table_noise, σ of it, 1/m; None without a table. thing, whole: (G + 1,) in
    [0, 1], how sure each group is a thing and a whole one. cuts: for pairs of neighbouring groups how sure it is that
    they are two.
    """

    number: Labels
    above_table: Float32Array | None
    table_noise: float
    thing: FloatArray
    whole: FloatArray
    cuts: dict[tuple[int, int], float]


@dataclass(frozen=True)
class PatchGroups:
    """parts: surfaces whose patches are what patches make in a first grouping; of_patch: (n + 1,) each patch's part.
    grouping: of the parts. features: (G + 1, len(OF_GROUP)) of the groups. whole: (G + 1,) how sure, in [0, 1], each is
    a whole thing.
    """

    parts: Surfaces
    of_patch: IntArray
    grouping: Grouping
    features: Float32Array
    whole: FloatArray


def group_patches(surfaces: Surfaces, relations: Relations, whole_rather: float = WHOLE_RATHER) -> PatchGroups:
    """Group the patches of an image, to parts first, and these to things: of two parts that are almost whole more can
    be said than of the patches on either side of their border. Specks, and scraps that are surely no whole thing, go
    with what they adjoin.

    whole_rather: as `Segmenter` takes it.
    """
    parts_rather = min(PARTS_RATHER, whole_rather)
    first = surfaces.group(relations.near, relations.far, parts_rather)
    of_patch = parts_of(surfaces, first)
    parts = surfaces.merged(of_patch)
    grouping = parts.group(relations.near_again, relations.far_again, whole_rather)
    # Halves go on in each other face by face, and faces are patches.
    odds = first.odds + np.where(first.adjoin, whole_rather - parts_rather, 0.0)
    faces = replace(first, group=grouping.group[of_patch], odds=odds)
    joined = np.zeros_like(grouping.group)
    joined[of_patch] = join_halves(faces, surfaces.sums.pixels).group
    grouping = replace(grouping, group=joined).without_specks(parts.sums.pixels)
    groups = _described(parts, of_patch, grouping, relations)
    pixels = groups.features[:, OF_GROUP.index("pixels")]
    scraps = np.flatnonzero((pixels > 0) & (pixels < SCRAP) & (groups.whole < SURELY_NO_WHOLE))
    if not len(scraps):
        return groups
    left = grouping.given_away(scraps[np.argsort(pixels[scraps])], LEAST_ODDS)
    return groups if np.array_equal(left.group, grouping.group) else _described(parts, of_patch, left, relations)


def parts_of(surfaces: Surfaces, first: Grouping) -> IntArray:
    """(n + 1,) the part, from 1 up and 0 for patch 0, that each patch is of after the first grouping."""
    group = first.without_specks(surfaces.sums.pixels).group
    return np.unique(group, return_inverse=True)[1].reshape(-1).astype(np.int64)


def _described(parts: Surfaces, of_patch: IntArray, grouping: Grouping, relations: Relations) -> PatchGroups:
    features = group_features(parts.sums_of_groups(grouping), grouping, parts.up)
    return PatchGroups(parts, of_patch, grouping, features, probability(relations.whole.log_odds(features)))


def group_by_surfaces(
    image: WorkingImage,
    valid: NDArray[np.bool_],
    plane: FloatArray | None,
    max_height: float,
    relations: Relations,
    whole_rather: float,
) -> SurfaceGroups:
    """Group the points of an image. valid: (N,) of its points. plane: (4,) of the table. max_height: m above it, over
    which nothing is looked at. whole_rather: as `Segmenter` takes it.
    """
    surfaces = Surfaces(image, plane, max_height)
    groups = group_patches(surfaces, relations, whole_rather)
    above, table, noise = None, None, 0.0
    if surfaces.relief is not None:
        table, noise = surfaces.relief.table, surfaces.relief.noise
        of_table = table.ravel() if image.pixel_a_point else table.ravel().take(image.cells, mode="clip")
        above = image.point_inverse_depth - of_table
    of_pixel = groups.grouping.group.astype(np.int32).take(groups.parts.labels)
    number = _of_points(image, of_pixel, table)
    number[~valid] = 0
    thing = probability(relations.thing.log_odds(groups.features))
    return SurfaceGroups(number, above, noise, thing, groups.whole, groups.grouping.cuts)


def _of_points(image: WorkingImage, of_pixel: Labels, table: Float32Array | None) -> Labels:
    """(N,) the number of each point: its pixel's, or, where it lies elsewhere than the most of that, a neighbour's."""
    if image.pixel_a_point:
        return of_pixel.reshape(-1).copy()
    h, w = of_pixel.shape
    inside = np.zeros((h, w), dtype=bool)
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        border = of_pixel[one] != of_pixel[other]
        inside[one] |= border
        inside[other] |= border
    q, numbers = image.inverse_depth.ravel(), of_pixel.ravel()
    flat = numbers.take(image.cells, mode="clip")
    flat[image.cells < 0] = 0
    # Only what is in a pixel of a group, or beside one, can be a group's.
    points = np.flatnonzero((inside.ravel() | (numbers > 0)).take(image.cells, mode="clip") & (image.cells >= 0))
    of_cell = image.cells[points]
    elsewhere = np.abs(q[of_cell] - image.point_inverse_depth[points]) > ALIKE
    points = points[inside.ravel()[of_cell] | (elsewhere & (numbers[of_cell] > 0))]
    cell, own = image.cells[points].astype(np.int64), image.point_inverse_depth[points]
    best = flat[points]
    off = np.abs(q[cell] - own)
    off[q[cell] == 0] = np.inf
    if table is not None:  # what is nearer to the table than to the object in its block is the table's
        down = np.abs(own - table.ravel()[cell])
        to_table = (down < off) & (down < ALIKE)
        best, off = np.where(to_table, 0, best), np.where(to_table, down, off)
    row, column = np.divmod(cell, w)
    doubtful = off > ALIKE
    for step, there in ((1, column < w - 1), (-1, column > 0), (w, row < h - 1), (-w, row > 0)):
        beside = np.where(there, cell + step, cell)
        apart = np.abs(q[beside] - own)
        better = doubtful & there & (q[beside] > 0) & (apart < off)
        best, off = np.where(better, numbers[beside], best), np.where(better, apart, off)
    flat[points] = np.where(off < FLYING, best, 0)
    return flat


def give_hidden(points: NDArray, number: Labels, hidden: IntArray) -> None:
    """Give points (K,) of a loose cloud (N, 3) that have no number that of the nearest one that has, step by step.

    Drawn from where the camera is taken to have stood, some points lie behind others.
    """
    for _ in range(STEPS):
        known = np.flatnonzero(number)
        if not len(known) or not len(hidden):
            return
        distance, nearest = cKDTree(points[known]).query(points[hidden], distance_upper_bound=STEP)
        near = np.isfinite(distance)
        number[hidden[near]] = number[known[nearest[near]]]
        hidden = hidden[~near]
