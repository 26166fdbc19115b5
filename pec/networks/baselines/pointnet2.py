"""PointNet++ with single-scale grouping: small PointNets on balls around farthest points, twice, then one on the rest.

Source: Qi, Yi, Su, Guibas, "PointNet++: Deep Hierarchical Feature Learning on Point Sets in a Metric Space", NeurIPS
2017, appendix B.1: SA(512, 0.2, [64, 64, 128]) → SA(128, 0.4, [128, 128, 256]) → SA([256, 512, 1024]) → FC(512, 0.5) →
FC(256, 0.5) → FC(K). At 40 classes 1,475,688 parameters, the 1.5 M that PointNeXt (NeurIPS 2022) counts for it.

Left open by the paper, or other here: it is laid out for 1,024 points in the unit sphere. For 64 points the same
shares of them are kept (1/2 and 1/8: 32 and 8 centres), the radii are doubled (0.4, 0.8), because the points of a
surface lie four times as far apart, and a ball holds at most 16 points, the nearest ones. Radii are in units of the
cloud's own radius: clouds come in metres.

At 64 points and 10 classes: 1.47 M parameters, 21.3 M multiply-adds.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.layers import Shared, shared_mlp
from pec.networks.baselines.neighbourhoods import balls, farthest_points, take

__all__ = ["PointNet2"]

_SHARES = (1 / 2, 1 / 8)  # of the points are centres
_RADII = (0.4, 0.8)  # of the cloud's radius
_BALL = 16  # points at most


class PointNet2(nn.Module):
    """PointNet++ (SSG) for clouds of at least 8 points; `n_points` sets the number of centres."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.n_centres = [max(int(share * n_points), 1) for share in _SHARES]
        self.levels = nn.ModuleList([shared_mlp(3, 64, 64, 128), shared_mlp(3 + 128, 128, 128, 256)])
        self.rest = shared_mlp(3 + 256, 256, 512, 1024)
        self.cloud = nn.Sequential(
            Shared(1024, 512), nn.Dropout(0.5), Shared(512, 256), nn.Dropout(0.5), nn.Linear(256, n_classes)
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) centred points in any order → (B, n_classes) logits."""
        cloud_radius = points.square().sum(dim=2).amax(dim=1).sqrt()[:, None, None]
        chosen = take(points, farthest_points(points, self.n_centres[0]))
        features = None
        for n_centres, radius, level in zip(self.n_centres, _RADII, self.levels, strict=True):
            centres = chosen[:, :n_centres]
            groups = balls(centres, points, features, radius * cloud_radius, _BALL)
            points, features = centres, level(groups).amax(dim=2)
        assert features is not None
        return self.cloud(self.rest(torch.cat([points, features], dim=2)).amax(dim=1))
