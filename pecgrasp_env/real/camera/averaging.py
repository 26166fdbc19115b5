"""One depth image out of several that were taken from one place."""

from __future__ import annotations

import numpy as np

_SEEN = 0.5  # of the frames, in which a pixel must have been measured
_APART = 0.01  # of the depth: farther from the median than this a value is of another surface


def mean_depth(depths: np.ndarray) -> np.ndarray:
    """(N, H, W) m, 0 or NaN for none → (H, W) float32, 0 for none.

    The mean of each pixel's values near their median; 0 where fewer than half of the frames measured it. A mean of all
    would put a pixel at an edge, which is now here and now there, into the air between.
    """
    depths = np.asarray(depths, np.float32)
    if depths.ndim != 3 or not len(depths):
        raise ValueError(f"depths of shape {depths.shape}: (N, H, W) with at least one frame")
    valid = np.isfinite(depths) & (depths > 0)
    if len(depths) == 1:
        return np.where(valid[0], depths[0], np.float32(0))
    count = valid.sum(axis=0)
    # The lower median of the measured values: sorted, those that are none come last.
    ordered = np.sort(np.where(valid, depths, np.inf), axis=0)
    at = np.maximum(count - 1, 0) // 2
    median = np.take_along_axis(ordered, at[None], axis=0)[0]
    median = np.where(count > 0, median, np.float32(0))
    near = valid & (np.abs(np.where(valid, depths, 0) - median) <= _APART * median)
    total = np.where(near, depths, 0).sum(axis=0, dtype=np.float64)
    enough = near.sum(axis=0) >= _SEEN * len(depths)
    return np.where(enough, total / np.maximum(near.sum(axis=0), 1), 0).astype(np.float32)
