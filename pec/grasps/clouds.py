"""The cloud of an object as the networks take it: a fixed number of points, spread over it, and normals."""

from __future__ import annotations

import numpy as np
import torch

from pec.preprocessing import compiled
from pec.preprocessing.preprocess import check_cloud, farthest_points

__all__ = ["FEWEST_POINTS", "spread_points", "surface_normals"]

FEWEST_POINTS = 10
"""Of a cloud; one with fewer than the networks take gives some of its points twice."""

_NEIGHBOURS = 16  # that a normal is fitted to


def spread_points(cloud: np.ndarray, n: int) -> np.ndarray:
    """(n, 3) float32 points of a cloud (N, 3) where it lies, by farthest point sampling; all, some twice, where N < n.

    The first of them are a sampling of fewer. Raises CloudError where it is not finite (N ≥ 10, 3).
    """
    cloud = np.ascontiguousarray(check_cloud(cloud, FEWEST_POINTS))
    chosen = min(n, len(cloud))
    centred = compiled.farthest_points(cloud, chosen, None) if compiled.AVAILABLE else None
    if centred is None:
        centred = farthest_points(cloud, chosen, None)
    mean = cloud.mean(axis=0, dtype=np.float64)
    return (centred + mean).astype(np.float32)[np.arange(n) % chosen]


def surface_normals(points: torch.Tensor) -> torch.Tensor:
    """(N, 3) unit normals, either way round, of the planes through the 16 nearest of points (N, 3)."""
    k = min(_NEIGHBOURS, len(points))
    members = torch.cdist(points, points).topk(k, dim=1, largest=False).indices
    groups = points[members]
    groups = groups - groups.mean(dim=1, keepdim=True)
    return torch.linalg.eigh(groups.transpose(1, 2) @ groups).eigenvectors[..., 0]
