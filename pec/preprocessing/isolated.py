"""Points that stand alone: strays of a sensor or a neighbour, which farthest points and outer positions take first."""

from __future__ import annotations

import numpy as np

from pec.preprocessing import compiled as kernels

__all__ = ["isolation", "reference", "without_isolated"]

_NEIGHBOUR = 4  # whose distance says how alone a point is: fewer stray together


def without_isolated(points: np.ndarray, limit: float, least: int) -> np.ndarray:
    """The finite `points` (N, 3), in their order, but for those that are more than `limit` times as isolated as their
    median; `least` of N ≥ least points stay, the least isolated.

    The measure of Rusu et al., "Towards 3D Point Cloud Based Object Maps for Household Environments", 2008, by ranks
    instead of means: the strays themselves do not move the limit. Of a cloud most of whose points come several times,
    so that the median is 0, all stay, and so they do of one of a handful of points.
    """
    if len(points) <= _NEIGHBOUR:
        return points
    distances = isolation(points)
    median = np.median(distances)
    if median == 0:
        return points
    return points[distances <= max(limit * median, np.partition(distances, least - 1)[least - 1])]


def isolation(points: np.ndarray) -> np.ndarray:
    """(N,) float64: distance of each of the finite points (N, 3), N > 4, from its fourth nearest neighbour."""
    return kernels.isolation(points) if kernels.AVAILABLE else reference(points)


def reference(points: np.ndarray) -> np.ndarray:
    """`isolation` without the compiled kernel."""
    from scipy.spatial import cKDTree  # slow to import

    distances: np.ndarray = cKDTree(points).query(points, [_NEIGHBOUR + 1])[0][:, 0]  # the nearest is the point itself
    return distances
