"""PointCNN: the neighbours of each point are weighted and permuted by a matrix learnt from where they lie, then a
convolution over them in their order, nearest first; four such layers.

Source: Li, Bu, Sun, Wu, Di, Chen, "PointCNN: Convolution On X-Transformed Points", NeurIPS 2018, algorithm 1 and the
released configurations for 64, 128 and 256 points: 8, 12, 16, 16 neighbours, widths 48, 96, 192, 384; where the last
layer's points lie, 96 wide; 384, 192, classes; ELU, then batch norm; dropout 0.8. At 40 classes 599,340 parameters, the
0.60 M of the paper's table.

Other here: the points that the last layers keep are the farthest ones, as in the paper's segmentation, not the first
ones, so that the order of the points decides nothing; the loss sees the mean over the points in training, too, not each
point by itself.

At 64 points and 10 classes: 0.59 M parameters, 36.3 M multiply-adds.
"""

from __future__ import annotations

import math

import torch
from torch import nn

from pec.errors import ConfigError
from pec.networks.baselines.neighbourhoods import farthest_points, nearest, take

__all__ = ["PointCNN"]

_LAYERS = ((8, 48), (12, 96), (16, 192), (16, 384))
"""Of each: neighbours, width."""
_SPARSE = {64: ((1, 2, 2, 3), 3 / 4), 128: ((1, 2, 3, 5), 3 / 4), 256: ((1, 2, 2, 4), 1 / 2)}
"""From so many points on: every how manieth of the nearest is a layer's neighbour; share of them in the last two."""
_MULTIPLIER = 4  # of the first layer's convolution
_DROPOUT = 0.8


class _Normalised(nn.Module):
    """Batch norm of rows (…, c), after an ELU or alone."""

    def __init__(self, width: int, *, activated: bool = True) -> None:
        super().__init__()
        self.activation = nn.ELU() if activated else nn.Identity()
        self.norm = nn.BatchNorm1d(width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.norm(self.activation(x).flatten(0, -2)).view(x.shape)


class _Dense(nn.Sequential):
    def __init__(self, c_in: int, c_out: int) -> None:
        super().__init__(nn.Linear(c_in, c_out, bias=False), _Normalised(c_out))


class _PerChannel(nn.Module):
    """(R, k, c) → (R, c, m): of each channel by itself m sums over the k neighbours."""

    def __init__(self, k: int, channels: int, multiplier: int) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.empty(channels, k, multiplier))
        nn.init.uniform_(self.weight, -1 / math.sqrt(k), 1 / math.sqrt(k))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.bmm(x.permute(2, 0, 1), self.weight).transpose(0, 1)


class _XConvolution(nn.Module):
    """Points (B, N, 3) and their features (B, N, c_in) → features (B, M, c_out) of the first M points."""

    def __init__(self, k: int, dilation: int, c_in: int, lifted: int, c_out: int, multiplier: int) -> None:
        """lifted: width that the neighbours' coordinates get beside the features. multiplier: of the convolution."""
        super().__init__()
        self.k, self.dilation = k, dilation
        self.lift = nn.Sequential(_Dense(3, lifted), _Dense(lifted, lifted))
        self.matrix = nn.Sequential(_Dense(3 * k, k * k), nn.Unflatten(1, (k, k)))
        self.matrix_again = nn.ModuleList([_PerChannel(k, k, k), _PerChannel(k, k, k)])
        self.norms = nn.ModuleList([_Normalised(k * k), _Normalised(k * k, activated=False)])
        self.each = _PerChannel(k, lifted + c_in, multiplier)
        self.join = _Dense(multiplier * (lifted + c_in), c_out)

    def forward(self, points: torch.Tensor, features: torch.Tensor | None, n_centres: int) -> torch.Tensor:
        centres = points[:, :n_centres]
        _, members = nearest(centres, points, self.k * self.dilation)
        members = members[..., :: self.dilation]
        local = take(points, members) - centres[:, :, None]
        x = self.lift(local)
        if features is not None:
            x = torch.cat([x, take(features, members)], dim=3)
        matrix = self.matrix(local.flatten(0, 1).flatten(1))
        for layer, norm in zip(self.matrix_again, self.norms, strict=True):
            matrix = norm(layer(matrix).flatten(1)).view(matrix.shape)
        rows = self.each(matrix @ x.flatten(0, 1))
        return self.join(rows.flatten(1)).view(*centres.shape[:2], -1)


class PointCNN(nn.Module):
    """PointCNN for clouds of `n_points` points, 64 or more."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        """Raises ConfigError where there are fewer points than its last layers take neighbours of."""
        super().__init__()
        if n_points < min(_SPARSE):
            raise ConfigError(f"model.name pointcnn takes 64 points or more, got preprocess.n_points {n_points}")
        dilations, share = _SPARSE[max(n for n in _SPARSE if n <= n_points)]
        self.kept = [n_points, n_points, int(share * n_points), int(share * n_points)]
        widths = [0, *(width for _, width in _LAYERS)]
        self.layers = nn.ModuleList()
        for (k, c_out), dilation, c_in in zip(_LAYERS, dilations, widths[:-1], strict=True):
            lifted, multiplier = (c_in // 4, math.ceil(c_out / c_in)) if c_in else (c_out // 2, _MULTIPLIER)
            self.layers.append(_XConvolution(k, dilation, c_in, lifted, c_out, multiplier))
        last = widths[-1]
        self.place = nn.Sequential(_Dense(3, last // 4), _Dense(last // 4, last // 4))
        self.points = nn.Sequential(_Dense(last // 4 + last, last), _Dense(last, last // 2), nn.Dropout(_DROPOUT))
        self.classes = nn.Linear(last // 2, n_classes)

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, n_points, 3) centred points in any order → (B, n_classes) logits."""
        points = take(points, farthest_points(points, points.shape[1]))
        x = None
        for layer, n_kept in zip(self.layers, self.kept, strict=True):
            x = layer(points, x, n_kept)
            points = points[:, :n_kept]
        assert x is not None
        x = self.points(torch.cat([self.place(points), x], dim=2))
        return self.classes(x.mean(dim=1))
