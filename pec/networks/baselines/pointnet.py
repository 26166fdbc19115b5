"""PointNet: every point by itself through one network, the maximum over the points, a classifier.

Source: Qi, Su, Mo, Guibas, "PointNet: Deep Learning on Point Sets for 3D Classification and Segmentation", CVPR 2017,
section 4.2, appendix C and table 6 (3.5 M parameters for 40 classes; without the two transforms, "vanilla", 0.8 M).

Left open by the paper, or other here: dropout is on the 256 wide layer only, as its text has it (keep 0.7); the
penalty on the feature transform is the mean over the batch; batch norm keeps torch's momentum instead of a schedule;
the rate and the batch are those of our protocol. Clouds are not scaled to the unit sphere: size is information.

At 64 points and 10 classes: PointNet 3.47 M parameters, 30.8 M multiply-adds; VanillaPointNet 0.81 M, 10.1 M.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.layers import Shared, shared_mlp

__all__ = ["PointNet", "Transform", "VanillaPointNet"]

_PENALTY = 0.001  # weight of the feature transform's distance from an orthogonal matrix, section 4.2


class Transform(nn.Module):
    """A T-Net: (B, N, size) → (B, size, size), the identity at first; `share` of the published widths."""

    def __init__(self, size: int, share: float = 1.0) -> None:
        super().__init__()
        self.size = size
        widths = [round(share * width) for width in (64, 128, 1024, 512, 256)]
        self.points = shared_mlp(size, *widths[:3])
        self.cloud = shared_mlp(*widths[2:])
        self.matrix = nn.Linear(widths[4], size * size)
        nn.init.zeros_(self.matrix.weight)
        with torch.no_grad():
            self.matrix.bias.copy_(torch.eye(size).flatten())

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.matrix(self.cloud(self.points(x).max(dim=1).values)).view(-1, self.size, self.size)


def _classifier(n_classes: int) -> nn.Sequential:
    return nn.Sequential(Shared(1024, 512), Shared(512, 256), nn.Dropout(0.3), nn.Linear(256, n_classes))


class VanillaPointNet(nn.Module):
    """PointNet without its transforms; `n_points` decides nothing, any number of points will do."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.points = shared_mlp(3, 64, 64, 64, 128, 1024)
        self.cloud = _classifier(n_classes)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) centred points in any order → (B, n_classes) logits."""
        return self.cloud(self.points(points).amax(dim=1))


class PointNet(nn.Module):
    """PointNet with both transforms; `n_points` decides nothing, any number of points will do."""

    penalty: torch.Tensor | None = None
    """After a forward in training: what belongs to the loss beside the cross-entropy."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.input_transform = Transform(3)
        self.low = shared_mlp(3, 64, 64)
        self.feature_transform = Transform(64)
        self.high = shared_mlp(64, 64, 128, 1024)
        self.cloud = _classifier(n_classes)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) centred points in any order → (B, n_classes) logits."""
        return self.cloud(self.features(points)[1])

    def features(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, N, 64) of each point, and (B, 1024) of the whole cloud."""
        x = self.low(points @ self.input_transform(points))
        matrix = self.feature_transform(x)
        if self.training:
            gap = torch.eye(64, device=x.device) - matrix @ matrix.transpose(1, 2)
            self.penalty = _PENALTY * gap.square().sum(dim=(1, 2)).mean()
        x = x @ matrix
        return x, self.high(x).amax(dim=1)
