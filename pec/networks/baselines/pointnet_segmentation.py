"""PointNet for semantic segmentation: each point's own features beside those of the whole cloud, then a class a point.

Source: Qi, Su, Mo, Guibas, "PointNet: Deep Learning on Point Sets for 3D Classification and Segmentation", CVPR 2017,
figure 2: 64 numbers of a point, after the feature transform, and 1,024 of the cloud → mlp(512, 256, 128) → mlp(128, K).
The classification form's layers up to there, transforms and penalty included.

The product of the concatenation is taken in two parts, the cloud's once and not for every point: the same function at
half of the multiply-adds.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.layers import Shared, shared_mlp
from pec.networks.baselines.pointnet import PointNet

__all__ = ["PointNetSegmentation"]


class PointNetSegmentation(PointNet):
    """`n_points` decides nothing, any number of points will do."""

    def __init__(self, n_points: int = 1024, n_classes: int = 6) -> None:
        super().__init__(n_points, n_classes)
        del self.cloud  # which classifies the whole
        self.of_point = nn.Linear(64, 512)
        self.of_cloud = nn.Linear(1024, 512, bias=False)
        self.norm = nn.BatchNorm1d(512)
        self.point = nn.Sequential(shared_mlp(512, 256, 128), Shared(128, 128), nn.Linear(128, n_classes))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) centred points in any order → (B, N, n_classes) logits."""
        point, cloud = self.features(points)
        x = self.of_point(point) + self.of_cloud(cloud)[:, None]
        return self.point(torch.relu(self.norm(x.flatten(0, 1))).view(x.shape))
