"""Farthest points and nearest neighbours in batches of small clouds, by all pairs: quickest at tens of points.

The order of the points decides nothing: sampling starts at the point farthest from the centroid, and of the points in
a neighbourhood the nearest are taken, so a network made of these is invariant to permutations (but for ties).
"""

from __future__ import annotations

import torch

__all__ = ["balls", "farthest_points", "nearest", "squared_distances", "take"]


def squared_distances(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """(B, N, C) and (B, M, C) → (B, N, M), not below zero; under autocast in float32, too.

    The product of bfloat16 is off by more than the squared distance between neighbours.
    """
    with torch.autocast(a.device.type, enabled=False):
        dtype = torch.promote_types(a.dtype, torch.float32)
        a, b = a.to(dtype), b.to(dtype)
        product = torch.baddbmm(b.square().sum(dim=2)[:, None], a, b.transpose(1, 2), alpha=-2)
        return (product + a.square().sum(dim=2)[:, :, None]).clamp_min(0)


def take(features: torch.Tensor, indices: torch.Tensor) -> torch.Tensor:
    """features (B, N, C) at indices (B, …) → (B, …, C)."""
    batch, n, channels = features.shape
    first = n * torch.arange(batch, device=features.device).view(-1, *[1] * (indices.dim() - 1))
    # Rows of one matrix: forward and backward twice as fast as by two indices.
    return features.flatten(0, 1).index_select(0, (first + indices).flatten()).view(*indices.shape, channels)


def nearest(queries: torch.Tensor, points: torch.Tensor, k: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Squared distances and indices (B, M, min(k, N)) of the points (B, N, C) nearest each query (B, M, C)."""
    found = squared_distances(queries, points).topk(min(k, points.shape[1]), dim=2, largest=False)
    return found.values, found.indices


@torch.no_grad()
def farthest_points(points: torch.Tensor, n: int) -> torch.Tensor:
    """Indices (B, n) of a farthest point sampling of (B, N, C), first the point farthest from the centroid.

    The first m of them are the sampling of m points, and also that of m points out of these n: a hierarchy of
    samplings is one sampling and its prefixes.
    """
    batch = torch.arange(points.shape[0], device=points.device)
    distances = squared_distances(points, points)
    index = (points - points.mean(dim=1, keepdim=True)).square().sum(dim=2).argmax(dim=1)
    chosen = [index]
    left = distances[batch, index]
    for _ in range(n - 1):
        index = left.argmax(dim=1)
        chosen.append(index)
        left = torch.minimum(left, distances[batch, index])
    return torch.stack(chosen, dim=1)


def balls(
    centres: torch.Tensor,
    points: torch.Tensor,
    features: torch.Tensor | None,
    radius: torch.Tensor | float,
    most: int,
) -> torch.Tensor:
    """(B, M, most, 3 + C): of each centre (B, M, 3) the nearest points (B, N, 3) within a radius, less the centre, and
    their features (B, N, C); places that stay empty repeat the nearest one, which a maximum does not see.

    radius: in the points' unit, or (B, 1, 1) of each cloud.
    """
    squared, members = nearest(centres, points, most)
    within = squared <= torch.as_tensor(radius, device=points.device).square()
    members = torch.where(within, members, members[..., :1])
    groups = take(points, members) - centres[:, :, None]
    return groups if features is None else torch.cat([groups, take(features, members)], dim=3)
