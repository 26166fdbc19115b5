"""What makes a vector of a cloud and its model, by the names that `network.encoder` takes.

Each takes points (B, N, 3) in its frame and in radii of the model, the line of sight (B, 3) there, and the model
(B,) int64, which becomes a learnt vector: what a dense layer makes of a one-hot vector, and CloudPose has that (Gao et
al., ICRA 2020).
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.layers import Shared, shared_mlp
from pec.preprocessing.ordering import anchor_positions, nearest_candidates

__all__ = ["ENCODERS", "Ordered", "PointNetEncoder"]

_WIDTH = 480


class Ordered(nn.Module):
    """PEC2's layers (`pec.networks.pec2`): fixed positions each take their nearest point, and dense layers read these.

    In the principal frame. At 64 points: 0.8 million multiply-adds a view.
    """

    frame = "principal"
    width = _WIDTH

    def __init__(self, n_points: int, n_models: int) -> None:
        super().__init__()
        self.n_points = n_points
        self.ordered = nn.Linear(3 * n_points, _WIDTH)
        self.point = shared_mlp(3, 64, 128)
        self.pooled = nn.Linear(2 * 128, _WIDTH)
        self.sight = nn.Linear(3, _WIDTH)
        self.model = nn.Embedding(n_models, _WIDTH)
        self.norm = nn.BatchNorm1d(_WIDTH)
        self.blocks = nn.Sequential(_Residual(), _Residual())

    def forward(self, points: torch.Tensor, sight: torch.Tensor, model: torch.Tensor) -> torch.Tensor:
        """(B, N, 3), (B, 3), (B,) → (B, 480)."""
        valid = torch.ones(points.shape[:2], dtype=torch.bool, device=points.device)
        order = nearest_candidates(points, valid, anchor_positions(self.n_points).to(points))
        points = points.gather(1, order[..., None].expand(-1, -1, 3))
        features = self.point(points)
        pooled = torch.cat([features.amax(dim=1), features.mean(dim=1)], dim=1)
        joined = self.ordered(points.flatten(1)) + self.pooled(pooled) + self.sight(sight) + self.model(model)
        return self.blocks(self.norm(joined).relu())


class PointNetEncoder(nn.Module):
    """Points one by one through layers that all share, and the maximum over them (PointNet, Qi et al., CVPR 2017).

    In the frame of the line of sight; the model beside each point and beside the cloud, as in CloudPose. At 64 points:
    5.2 million multiply-adds.
    """

    frame = "sight"
    width = 256

    def __init__(self, n_points: int, n_models: int) -> None:
        super().__init__()
        self.first = nn.Linear(3, 64)
        self.beside_point = nn.Embedding(n_models, 64)
        self.points = nn.Sequential(nn.BatchNorm1d(64), nn.ReLU(), shared_mlp(64, 64, 128, 512))
        self.beside_cloud = nn.Embedding(n_models, 64)
        self.cloud = nn.Sequential(Shared(512 + 64, 512), Shared(512, 256))

    def forward(self, points: torch.Tensor, sight: torch.Tensor, model: torch.Tensor) -> torch.Tensor:
        """(B, N, 3), any, (B,) → (B, 256); the line of sight is the z axis."""
        rows = (self.first(points) + self.beside_point(model)[:, None]).flatten(0, 1)
        cloud = self.points(rows).unflatten(0, points.shape[:2]).amax(dim=1)
        return self.cloud(torch.cat([cloud, self.beside_cloud(model)], dim=1))


class _Residual(nn.Module):
    """relu(x + f(x)), f through half the width, batch-normalised."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(Shared(_WIDTH, _WIDTH // 2), nn.Linear(_WIDTH // 2, _WIDTH), nn.BatchNorm1d(_WIDTH))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return (x + self.layers(x)).relu()


ENCODERS: dict[str, type[Ordered] | type[PointNetEncoder]] = {"ordered": Ordered, "pointnet": PointNetEncoder}
