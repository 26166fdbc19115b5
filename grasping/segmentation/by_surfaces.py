"""Objects of a frame whose lines of sight are known: told apart by their surfaces, also where they touch."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.boosted_trees import Relations
from grasping.segmentation.surfaces import Grouping, Surfaces
from grasping.segmentation.working_image import ALIKE, WorkingImage

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Labels = NDArray[np.int32]

FLYING = 0.03  # 1/m from all pixels around: a point in the air
LEAST_OBJECT = 40  # pixels of the working image; less goes to the neighbour that it is likest of one object with
MAY_BELONG = -1.5  # log odds of that


@dataclass(frozen=True)
class SurfaceGroups:
    """number: (N,) each point's group, from 1 up, 0 for none. above_table: (N,) 1/m by which a point is nearer than the
    table as the sensor bends it, and table_noise, σ of it, 1/m; None without a table. confidence: (G + 1,) in [0, 1],
    how sure each group is. cuts: for pairs of neighbouring groups how sure it is that they are two.
    """

    number: Labels
    above_table: Float32Array | None
    table_noise: float
    confidence: FloatArray
    cuts: dict[tuple[int, int], float]


def group_by_surfaces(
    image: WorkingImage, valid: NDArray[np.bool_], plane: FloatArray | None, max_height: float, relations: Relations
) -> SurfaceGroups:
    """Group the points of an image. valid: (N,) of its points. plane: (4,) of the table. max_height: m above it, over
    which nothing is looked at.
    """
    surfaces = Surfaces(image, plane, max_height)
    grouping = surfaces.group(relations)
    group = _absorb(grouping, surfaces.measures.pixels)
    of_pixel = group[surfaces.labels].astype(np.int32)
    table = None if surfaces.relief is None else surfaces.relief.table
    number = _of_points(image, of_pixel, table)
    number[~valid] = 0
    above = None
    if table is not None:
        above = image.point_inverse_depth - table.ravel()[np.maximum(image.cells, 0)]
    noise = 0.0 if surfaces.relief is None else surfaces.relief.noise
    grouping = replace(grouping, group=group)
    return SurfaceGroups(number, above, noise, grouping.joins, grouping.cuts())


def _absorb(grouping: Grouping, pixels: FloatArray) -> IntArray:
    """(n + 1,) the patches' groups, small ones given to a neighbour that they may belong to."""
    group = grouping.group.copy()
    sizes = np.bincount(group, pixels, minlength=int(group.max(initial=0)) + 1)
    one, other = group[grouping.first], group[grouping.second]
    for small in np.flatnonzero(sizes < LEAST_OBJECT):
        beside = ((one == small) ^ (other == small)) & (small > 0) & grouping.adjoin
        if not beside.any():
            continue
        neighbour = np.where(one == small, other, one)[beside]
        weight = np.bincount(neighbour, grouping.length[beside])
        total = np.bincount(neighbour, (grouping.odds * grouping.length)[beside])
        mean = np.where(weight > 0, total / np.maximum(weight, 1e-9), -np.inf)
        best = int(mean.argmax())
        if mean[best] > MAY_BELONG:
            group[group == small] = best
            one, other = group[grouping.first], group[grouping.second]
    return group


def _of_points(image: WorkingImage, of_pixel: Labels, table: Float32Array | None) -> Labels:
    """(N,) the number of each point: its pixel's, or, where it lies elsewhere than the most of that, a neighbour's."""
    flat = np.where(image.cells >= 0, of_pixel.ravel()[np.maximum(image.cells, 0)], np.int32(0))
    if len(image.cells) == of_pixel.size and image.cells[-1] == of_pixel.size - 1:
        return flat  # a pixel a point
    h, w = of_pixel.shape
    inside = np.zeros((h, w), dtype=bool)
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        border = of_pixel[one] != of_pixel[other]
        inside[one] |= border
        inside[other] |= border
    points = np.flatnonzero(inside.ravel()[np.maximum(image.cells, 0)] & (image.cells >= 0))
    cell, own = image.cells[points].astype(np.int64), image.point_inverse_depth[points]
    q = image.inverse_depth.ravel()
    numbers = of_pixel.ravel()
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
