"""Tell low patches that rise from the table like a wrinkle from those that rise like a thing, by an edge.

What a camera bends more than a cubic surface takes off, in the corners of its view above all, and what its noise heaps
up beside a thing, comes out of the table little by little; the thinnest sheet does so from one pixel to the next.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.table_relief import Relief, mean_of_nine

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Labels = NDArray[np.int32]

LOW, MOSTLY = 0.015, 0.95  # m above the table, and of a patch's pixels, that lie lower
REACH = 3  # pixels on either side of the border with the table, within which a thing rises
GRADUAL = 0.5  # of what three quarters of its pixels have, that a wrinkle has risen by there, in the median
LEAST_FOOT = 0.25  # of a patch's outline, along the table: else nobody sees how it rises
MOST = np.float32(0.05)  # 1/m of relief that counts


def wrinkles(
    labels: Labels, count: int, relief: Relief, inverse_depth: Float32Array, camera: float
) -> NDArray[np.bool_]:
    """(count + 1,) which of the patches (h, w), from 1 to count, are wrinkles of the table. camera: m above it."""
    if kernels.compiled is None:
        return wrinkles_reference(labels, count, relief, inverse_depth, camera)
    found = np.empty(count + 1, dtype=bool)
    kernels.compiled.find_wrinkles(labels, inverse_depth, relief.above, relief.stands_out, camera, found)
    return found


def wrinkles_reference(
    labels: Labels, count: int, relief: Relief, inverse_depth: Float32Array, camera: float
) -> NDArray[np.bool_]:
    """`wrinkles` in NumPy."""
    at = np.flatnonzero(labels > 0)
    own = labels.ravel().take(at)
    # Along a line of sight the height over the table falls evenly with the distance from the camera.
    above = np.minimum(relief.above.ravel().take(at), MOST)
    high = above * np.float32(camera) > np.float32(LOW) * inverse_depth.ravel().take(at)
    pixels = np.bincount(own, minlength=count + 1)
    low = np.bincount(own[high], minlength=count + 1) <= (1 - MOSTLY) * pixels
    low[0] = False
    if not low.any():
        return low
    inside = np.flatnonzero(low[own])
    at, own, above = at[inside], own[inside], above[inside]
    patch, rise, outline = _rises(labels, count, at, own, relief, inverse_depth)
    foot = np.bincount(patch, minlength=count + 1)
    seen = low & (foot > 0) & (foot >= LEAST_FOOT * outline)
    risen, most = _quantile(patch, rise, count, 0.5), _quantile(own, above, count, 0.75)
    return np.asarray(seen & (risen < GRADUAL * most))


def _rises(
    labels: Labels, count: int, at: IntArray, own: Labels, relief: Relief, inverse_depth: Float32Array
) -> tuple[IntArray, Float32Array, IntArray]:
    """(B,) the patch and the rise, 1/m, at each side of one of the pixels (P,) that is beside the open table; and
    (count + 1,) how many sides each patch's outline has.
    """
    h, w = labels.shape
    mean = mean_of_nine(relief.above, inverse_depth, float(MOST)).ravel()
    flat = labels.ravel()
    table = ((inverse_depth > 0) & ~relief.stands_out).ravel() & (flat == 0)
    row, column = np.divmod(at, w)
    before, after = (row, column), (h - 1 - row, w - 1 - column)  # pixels up to the image's border
    ways = ((-w, before[0], after[0]), (w, after[0], before[0]), (-1, before[1], after[1]), (1, after[1], before[1]))
    patches, rises, outline = [], [], np.zeros(count + 1, dtype=np.int64)
    for step, room, behind in ways:
        beside = np.where(room > 0, at + step, at)
        outline += np.bincount(own[(room == 0) | (flat[beside] != own)], minlength=len(outline))
        # A gap that is narrower than the reach shows nothing of the table.
        foot = np.flatnonzero((room >= REACH) & table[beside])
        for far in range(2, REACH + 1):
            foot = foot[table[at[foot] + far * step]]
        start, back = at[foot], behind[foot]
        high = mean[start]
        for far in range(1, REACH + 1):
            inner = np.where(back >= far, start - far * step, start)
            high = np.where(flat[inner] > 0, np.maximum(high, mean[inner]), high)
        patches.append(own[foot].astype(np.int64))
        rises.append(high - mean[start + REACH * step])
    return np.concatenate(patches), np.concatenate(rises), outline


def _quantile(group: IntArray | Labels, values: Float32Array, count: int, share: float) -> Float32Array:
    """(count + 1,) of the values (V,) of each group; 0 for none."""
    ordered = values[np.lexsort((values, group))]
    sizes = np.bincount(group, minlength=count + 1)
    start = np.cumsum(sizes) - sizes
    found = np.zeros(count + 1, dtype=np.float32)
    some = np.flatnonzero(sizes)
    found[some] = ordered[start[some] + (share * (sizes[some] - 1)).astype(np.int64)]
    return found
