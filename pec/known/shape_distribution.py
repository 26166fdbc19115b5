"""A cloud's size and shape in 37 numbers that no rotation changes, quick for one cloud.

Quantiles of the distances between its points and of those to their centroid, and the spread along the principal axes
(D2 and D1 of Osada et al., "Shape Distributions", ACM TOG 2002): `pec.networks.baselines.knn.describe`, of which this
is the same in NumPy, or compiled. A network forgets what does not tell its classes apart; this does not.
"""

from __future__ import annotations

import numpy as np

from pec.preprocessing import compiled as kernels

__all__ = ["N_AXES", "N_DESCRIPTORS", "describe_cloud", "reference"]

N_AXES = 3
"""The last numbers of a descriptor: the spreads along the principal axes, the smallest first."""
N_DESCRIPTORS = 37

_POINTS = 64  # that are looked at: farthest point sampling gives the first of them an even spread
_QUANTILES = 17


def describe_cloud(points: np.ndarray) -> np.ndarray:
    """Descriptor (37,) float64, metres, of the first 64 of `points` (N, 3), N > 0."""
    if kernels.AVAILABLE and points.dtype == np.float32:
        return kernels.described(points[:_POINTS])
    return reference(points)


def reference(points: np.ndarray) -> np.ndarray:
    """`describe_cloud` without the compiled kernel."""
    points = points[:_POINTS].astype(np.float64)
    n = len(points)
    points -= points.mean(axis=0)
    rows, columns = np.triu_indices(n, 1)
    pairs = np.linalg.norm(points[rows] - points[columns], axis=1) if n > 1 else np.zeros(1)
    axes = np.sqrt(np.linalg.eigvalsh(points.T @ points / n).clip(min=0))
    return np.concatenate([_quantiles(pairs), _quantiles(np.linalg.norm(points, axis=1)), axes])


def _quantiles(values: np.ndarray) -> np.ndarray:
    return np.sort(values)[np.round(np.linspace(0, 1, _QUANTILES) * (len(values) - 1)).astype(np.int64)]
