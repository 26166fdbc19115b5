"""Take things apart that hang together only low over the table, as filters smear their feet into each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.segmentation.footprints import label_footprints

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CUTS = (0.02, 0.03, 0.04, 0.06)  # m above the table, below which nothing joins
PROMINENT = 2.0  # times as high as the cut is each of the parts, else the cut went through one thing's top


def parts_above_saddles(flat: FloatArray, height: NDArray, gap: float, pitch: float, least: int) -> IntArray | None:
    """Number (M,) of the part that each point of a cluster belongs to, by the lowest cut above which it falls apart.

    flat (M, 2), height (M,): of the points on and above the table, m. gap, pitch: as for `label_footprints`. least:
    points; smaller parts stay with the nearest. None where no cut tells parts apart.
    """
    for cut in CUTS:
        high = np.flatnonzero(height > cut)
        labels = label_footprints(flat[high], gap, pitch)
        sizes = np.bincount(labels[labels >= 0])
        tall = np.zeros(len(sizes), dtype=bool)
        tall[labels[(labels >= 0) & (height[high] > PROMINENT * cut)]] = True
        large = np.flatnonzero((sizes >= least) & tall)
        if len(large) > 1:
            core = np.isin(labels, large)
            nearest = cKDTree(flat[high[core]]).query(flat)[1]
            return np.asarray(np.searchsorted(large, labels[core][nearest]), dtype=np.int64)
    return None
