"""PEC2: two witnesses, one of a cloud's shape and one of its size, that are heard apart in training.

Shape. Where fixed positions order the points (`ordering=anchors`), coordinate i always answers the same question: what
is nearest to position i? Dense layers can read that at once; PEC's convolutions over x, y, z and its narrow,
unnormalised decoder only make it hard to train. What the dense layers learn at one position they do not know at
another; the layers for single points, alike for all (as PointNet's, Qi et al. 2017), do. Points come at unit size.

Size. Its extents along the axes, in metres. In one network with the shape they would not be listened to: shapes can be
learnt by heart, and then nothing is left for the size to explain. So each training cloud is answered by one of the two
alone, by chance (Neverova et al., "ModDrop", TPAMI 2016), and in prediction their logits are added, as independent
evidence is.

At 64 points and 10 classes: 705,204 parameters, 1.5 million multiply-adds a view (PEC: 890,666 and 2.3 million).
"""

from __future__ import annotations

import torch
from torch import nn

__all__ = ["PEC2"]

_WIDTH = 480
_POINT_WIDTH = 64
_POINT_FEATURES = 128
_DROPOUT = 0.3
_SIZE_WIDTH = 64
_SIZE_DROPOUT = 0.1
_SIZE_ALONE = 0.3  # share of the training clouds that are answered by their size
_SMALLEST = 1e-4  # m, of an extent: a plate's, seen by an exact camera


class PEC2(nn.Module):
    """PEC2 for clouds of `n_points` points and `n_classes` classes."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.n_points = n_points
        self.ordered = nn.Sequential(nn.Linear(3 * n_points, _WIDTH), nn.BatchNorm1d(_WIDTH))
        self.point = nn.Sequential(
            *_dense(3, _POINT_WIDTH),
            *_dense(_POINT_WIDTH, _POINT_WIDTH),
            *_dense(_POINT_WIDTH, _POINT_FEATURES),
        )
        self.pooled = nn.Sequential(nn.Dropout(_DROPOUT), nn.Linear(2 * _POINT_FEATURES, _WIDTH))
        self.blocks = nn.Sequential(_Residual(), _Residual())
        self.head = nn.Sequential(nn.Dropout(_DROPOUT), nn.Linear(_WIDTH, n_classes))
        self.size = nn.Sequential(
            nn.BatchNorm1d(3, affine=False),
            nn.Hardtanh(-3.0, 3.0),
            nn.Linear(3, _SIZE_WIDTH),
            nn.ReLU(),
            nn.Dropout(_SIZE_DROPOUT),
            nn.Linear(_SIZE_WIDTH, _SIZE_WIDTH),
            nn.ReLU(),
            nn.Dropout(_SIZE_DROPOUT),
            nn.Linear(_SIZE_WIDTH, n_classes),
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, n_points, 3) ordered, centred points in metres → (B, n_classes) logits."""
        logits, _ = self.embed(points)
        return logits

    def embed(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, n_points, 3) → (B, n_classes) logits and the features of the shape, (B, 480)."""
        squared = points.square().mean(dim=1).clamp_min(_SMALLEST**2)
        by_size = self.size(0.5 * squared.log())
        shape = self._shape(points * squared.sum(dim=1).rsqrt()[:, None, None])
        by_shape = self.head(shape)
        if self.training:
            return torch.where(torch.rand_like(by_size[:, :1]) < _SIZE_ALONE, by_size, by_shape), shape
        return by_shape + by_size, shape

    def _shape(self, points: torch.Tensor) -> torch.Tensor:
        features = self.point(points.flatten(0, 1)).unflatten(0, (-1, self.n_points))
        pooled = torch.cat([features.amax(dim=1), features.mean(dim=1)], dim=1)
        joined = (self.ordered(points.flatten(1)) + self.pooled(pooled)).relu()
        return self.blocks(joined)


class _Residual(nn.Module):
    """relu(x + f(x)), f through half the width, batch-normalised."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            *_dense(_WIDTH, _WIDTH // 2),
            nn.Dropout(_DROPOUT),
            nn.Linear(_WIDTH // 2, _WIDTH),
            nn.BatchNorm1d(_WIDTH),
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return (x + self.layers(x)).relu()


def _dense(n_in: int, n_out: int) -> tuple[nn.Module, ...]:
    return nn.Linear(n_in, n_out), nn.BatchNorm1d(n_out), nn.ReLU()
