"""Clusters of points that chains of small steps join."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def euclidean_clusters(points: FloatArray, tolerance: float) -> IntArray:
    """Label (N,) of each point: two points share one where a chain of steps of at most the tolerance (m) joins them.

    Labels are 0, 1, … from the largest cluster to the smallest.
    """
    # SciPy is slow to import, and the default planner, which needs this module's axes, does without.
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(points)
    pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels)
    rank = np.empty(len(sizes), dtype=np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    return rank[labels]


def voxel_clusters(points: FloatArray, tolerance: float) -> IntArray:
    """Euclidean clusters (N,) of a dense cloud, joined through one point in each cube of a fifth of the tolerance."""
    if not len(points):
        return np.empty(0, dtype=np.int64)
    cubes = np.floor((points - points.min(axis=0)) / (tolerance / 5)).astype(np.int64)
    size = cubes.max(axis=0) + 1
    key = (cubes[:, 0] * size[1] + cubes[:, 1]) * size[2] + cubes[:, 2]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return euclidean_clusters(points[first], tolerance)[inverse.reshape(-1)]


def by_label(labels: NDArray[np.integer[Any]]) -> list[IntArray]:
    """Indices of each label from 0 up."""
    if not len(labels) or labels.max() < 0:
        return []
    order = np.argsort(labels, kind="stable")
    bounds = np.searchsorted(labels[order], np.arange(labels.max() + 2))
    return [order[start:stop] for start, stop in pairwise(bounds)]
