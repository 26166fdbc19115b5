"""PointNet++ for semantic segmentation: four levels of balls, and features propagated back to every point.

Source: Qi, Yi, Su, Guibas, "PointNet++: Deep Hierarchical Feature Learning on Point Sets in a Metric Space", NeurIPS
2017, section 3.4 and appendix B.1: SA(1024, 0.1, [32, 32, 64]) → SA(256, 0.2, [64, 64, 128]) → SA(64, 0.4, [128, 128,
256]) → SA(16, 0.8, [256, 256, 512]) → FP(256, 256) → FP(256, 256) → FP(256, 128) → FP(128, 128, 128) → FC(128, 0.5) →
FC(K). A level's features reach the points of the one below by the mean of the 3 nearest, weighted by the inverse of
their distance, beside what that level had itself (skip links).

Other here: the paper's is laid out for 8,192 points of rooms, in metres. Each level keeps a quarter of the points, as
there from the second on, the radii are a fifth of the paper's (2 to 16 cm, for a table instead of a room), a ball holds
at most 16 points, as in our classification form, and weights are by the distance, as in its equation 2 with p = 1.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.layers import Shared, shared_mlp
from pec.networks.baselines.neighbourhoods import balls, farthest_points, nearest, take

__all__ = ["PointNet2Segmentation", "interpolated"]

_RADII_M = (0.02, 0.04, 0.08, 0.16)
_BALL = 16  # points at most
_NEAREST = 3


class PointNet2Segmentation(nn.Module):
    """For clouds of at least 256 points; `n_points` decides nothing."""

    def __init__(self, n_points: int = 1024, n_classes: int = 6) -> None:
        super().__init__()
        self.down = nn.ModuleList(
            [
                shared_mlp(3, 32, 32, 64),
                shared_mlp(3 + 64, 64, 64, 128),
                shared_mlp(3 + 128, 128, 128, 256),
                shared_mlp(3 + 256, 256, 256, 512),
            ]
        )
        self.up = nn.ModuleList(
            [
                shared_mlp(512 + 256, 256, 256),
                shared_mlp(256 + 128, 256, 256),
                shared_mlp(256 + 64, 256, 128),
                shared_mlp(128, 128, 128, 128),
            ]
        )
        self.point = nn.Sequential(Shared(128, 128), nn.Dropout(0.5), nn.Linear(128, n_classes))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) points in any order, m → (B, N, n_classes) logits."""
        chosen = take(points, farthest_points(points, points.shape[1] // 4))
        levels: list[tuple[torch.Tensor, torch.Tensor | None]] = [(points, None)]
        for radius, layers in zip(_RADII_M, self.down, strict=True):
            below, features = levels[-1]
            centres = chosen[:, : below.shape[1] // 4]
            levels.append((centres, layers(balls(centres, below, features, radius, _BALL)).amax(dim=2)))
        coarse, x = levels.pop()
        assert x is not None
        for layers in self.up:
            fine, own = levels.pop()
            x = interpolated(fine, coarse, x)
            x = layers(x if own is None else torch.cat([x, own], dim=2))
            coarse = fine
        return self.point(x)


def interpolated(fine: torch.Tensor, coarse: torch.Tensor, features: torch.Tensor) -> torch.Tensor:
    """Features (B, M, C) of coarse points (B, M, 3) at the fine ones (B, N, 3): (B, N, C)."""
    squared, index = nearest(fine, coarse, _NEAREST)
    weight = 1 / squared.sqrt().clamp_min(1e-6)
    weight = (weight / weight.sum(dim=2, keepdim=True)).to(features.dtype)
    return (take(features, index) * weight[..., None]).sum(dim=2)
