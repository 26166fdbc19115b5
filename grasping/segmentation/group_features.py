"""What is known of a group of patches, as numbers from which trees tell whether it is a thing, and a whole one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.grouping import Grouping
from grasping.segmentation.patch_measures import PatchSums, extents, fit_quadratics, measures_of

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
OF_PATCHES = ["patches", "join", "cut", "cuts", "share_cut"]  # what the patches say; the rest is said by the pixels
OF_SHAPE = [name for name in OF_GROUP if name not in OF_PATCHES]


def group_features(groups: PatchSums, grouping: Grouping, up: FloatArray | None) -> Float32Array:
    """(G + 1, len(OF_GROUP)), row 0 without meaning. groups: the sums of groups."""
    count = len(groups.sums)
    features = np.empty((count, len(OF_GROUP)), dtype=np.float32)
    features[:, [OF_GROUP.index(name) for name in OF_SHAPE]] = shapes_of_groups(groups, up)
    patches = np.bincount(grouping.group, minlength=count)
    for name, values in zip(OF_PATCHES, (patches, *_sureness(grouping, count)), strict=True):
        features[:, OF_GROUP.index(name)] = values
    return features


def shapes_of_groups(groups: PatchSums, up: FloatArray | None) -> Float32Array:
    """(G + 1, len(OF_SHAPE)) of groups."""
    if kernels.compiled is None:
        return shapes_of_groups_reference(groups, up)
    features = np.empty((len(groups.sums), len(OF_SHAPE)), dtype=np.float32)
    kernels.compiled.describe_groups(groups.sums, groups.bins, groups.sides, groups.with_table, up, features)
    return features


def shapes_of_groups_reference(groups: PatchSums, up: FloatArray | None) -> Float32Array:
    """`shapes_of_groups` in NumPy."""
    measures = measures_of(groups)
    pixels = np.maximum(measures.pixels, 1.0)
    x, y, z = measures.normal.T
    normal = np.sqrt(x * x + y * y + z * z)
    rising = np.full(len(pixels), np.nan)
    if up is not None:
        rising = (x * up[0] + y * up[1] + z * up[2]) / np.maximum(normal, 1e-9)
    axes = extents(measures.scatter)
    sums = (measures.moments, measures.products, measures.squares, measures.pixels)
    plane, quadric = (fit_quadratics(*sums, terms)[0] for terms in (3, 6))
    # Of its bounding ellipse, how much it fills; an ellipse's area is 4 π times the product of its deviations.
    fill = measures.area / np.maximum(4 * np.pi * axes[:, 1] * axes[:, 2], 1e-9)
    rows = [measures.pixels, measures.area, *measures.heights.T]
    rows += [*measures.sides.T, measures.edge, measures.outline / np.sqrt(pixels)]
    rows += [plane, quadric, 1 - normal, rising, *axes.T, *measures.over.T, fill]
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
