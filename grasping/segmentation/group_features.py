"""What is known of a group of patches, as numbers from which trees tell whether it is a thing, and a whole one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.grouping import Grouping
from grasping.segmentation.patch_measures import PatchMeasures, extents, fit_quadratics

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]

OF_GROUP = [
    *("pixels", "area", "patches", "height_5", "height_50", "height_95"),
    *("table", "stands", "nothing", "image", "edge", "outline"),
    *("plane", "quadric", "spread", "up", "extent_0", "extent_1", "extent_2"),
    *("relief", "relief_least", "fill"),
    *("join", "cut", "cuts", "share_cut"),
]


def group_features(measures: PatchMeasures, grouping: Grouping, up: FloatArray | None) -> Float32Array:
    """(G + 1, len(OF_GROUP)), row 0 without meaning. measures: of the groups."""
    count = len(measures.pixels)
    pixels = np.maximum(measures.pixels, 1.0)
    unknown = np.full(count, np.nan)
    patches = np.bincount(grouping.group, minlength=count).astype(np.float64)
    normal = np.linalg.norm(measures.normal, axis=1)
    rising = unknown if up is None else measures.normal @ up / np.maximum(normal, 1e-9)
    axes = extents(measures.scatter)
    sums = (measures.moments, measures.products, measures.squares, measures.pixels)
    plane, quadric = (fit_quadratics(*sums, terms)[0] for terms in (3, 6))
    low, middle, high = measures.heights.T
    # Of its bounding ellipse, how much it fills; an ellipse's area is 4 π times the product of its deviations.
    fill = measures.area / np.maximum(4 * np.pi * axes[:, 1] * axes[:, 2], 1e-9)
    join, cut, cuts, share = _sureness(grouping, count)
    rows = [measures.pixels, measures.area, patches, low, middle, high]
    rows += [*measures.sides.T, measures.edge, measures.outline / np.sqrt(pixels)]
    rows += [plane, quadric, 1 - normal, rising, *axes.T, *measures.over.T, fill, join, cut, cuts, share]
    return np.stack(rows, axis=1).astype(np.float32)


def _sureness(grouping: Grouping, count: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(G + 1,) each: the least sure join and cut, the number of cuts, and the length of borders that were cut."""
    join, cut, length = np.ones(count), np.ones(count), np.zeros(count)
    join[: len(grouping.joins)] = grouping.joins[:count]
    low, high, sure = grouping.between
    both = np.concatenate([low, high])
    np.minimum.at(cut, both, np.concatenate([sure, sure]))
    cuts = np.bincount(both, minlength=count).astype(np.float64)
    apart = grouping.group[grouping.first] != grouping.group[grouping.second]
    for patch in (grouping.first, grouping.second):
        length += np.bincount(grouping.group[patch[apart]], grouping.length[apart], minlength=count)
    return join, cut, cuts, length
