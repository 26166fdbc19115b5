"""GDANet: edge convolutions whose features attend to the sharp and to the gentle parts of the cloud, each apart.

Source: Xu, Zhang, Zhou, Xu, Qi, Qiao, "Learning Geometry-Disentangled Representation for Complementary Understanding of
3D Object Point Cloud", AAAI 2021, and the released configuration: two layers an edge, widths 64, 64, 128; a quarter of
the points sharpest and a quarter gentlest; 512, maximum and mean over the points; 512, 256, classes; dropout 0.4. At 40
classes 936,616 parameters, as the released network has.

Left open by the paper, or other here: it takes 30 neighbours at 1,024 points; at 64, 15. How much a point differs from
its surroundings is judged by all points nearer than the paper's threshold, which are the 64 nearest at most there.

At 64 points and 10 classes: 0.93 M parameters, 40.9 M multiply-adds.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.layers import Shared
from pec.networks.baselines.neighbourhoods import nearest, squared_distances, take

__all__ = ["GDANet", "sharp_and_gentle"]

_K = 15  # neighbours, the point itself among them
_SHARE = 1 / 4  # of the points are called sharp, as many gentle
_REACH = 0.2  # of a point's surroundings, in the space of the features
_WIDTH = 2.0  # of the Gaussian by which they count
_DROPOUT = 0.4


class _EdgeConvolution(nn.Module):
    """(B, N, c_in) → (B, N, c_out): two layers on each edge (x_j - x_i, x_j), the maximum over the neighbours j."""

    def __init__(self, c_in: int, c_out: int) -> None:
        super().__init__()
        self.first = nn.Linear(2 * c_in, c_out)
        self.norm = nn.BatchNorm1d(c_out)
        self.second = Shared(c_out, c_out)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        _, neighbours = nearest(x, x, _K)
        # The dense layer of an edge is that of x_j less that of x_i: each is computed once a point.
        of_difference, of_neighbour = self.first.weight.chunk(2, dim=1)
        of_point = nn.functional.linear(x, of_difference + of_neighbour, self.first.bias)
        edges = take(of_point, neighbours) - (x @ of_difference.T)[:, :, None]
        rows = torch.relu(self.norm(edges.flatten(0, 2)))
        return self.second(rows.view(edges.shape)).amax(dim=2)


def sharp_and_gentle(x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Features (B, M, C) of those of the points (B, N, C) that differ most and least from the weighted mean of their
    surroundings: a graph's high-pass filter."""
    squared = squared_distances(x, x)
    weight = torch.where(squared < _REACH**2, (-squared / _WIDTH**2).exp(), 0.0)
    others = weight * (1 - torch.eye(x.shape[1], device=x.device))
    variation = (x - others @ x / (1 + others.sum(dim=2, keepdim=True))).square().sum(dim=2)
    n = max(int(_SHARE * x.shape[1]), 1)
    sharp, gentle = (variation.topk(n, dim=1, largest=largest).indices for largest in (True, False))
    return take(x, sharp), take(x, gentle)


class _Attention(nn.Module):
    """x (B, N, c) and `others` (B, M, c) → (B, N, c): x and what it attends to among the others; at first x alone."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.query = nn.Linear(width, width // 2)
        self.key = nn.Linear(width, width // 2)
        self.value = nn.Linear(width, width // 2)
        self.wide = nn.Linear(width // 2, width)
        self.norm = nn.BatchNorm1d(width)
        nn.init.zeros_(self.norm.weight)

    def forward(self, x: torch.Tensor, others: torch.Tensor) -> torch.Tensor:
        attention = self.query(x) @ self.key(others).transpose(1, 2) / others.shape[1]
        rows = self.wide(attention @ self.value(others)).flatten(0, 1)
        return x + self.norm(rows).view(x.shape)


class _Block(nn.Module):
    """(B, N, c_in) → (B, N, c_out): an edge convolution that attends to its sharp and its gentle points."""

    def __init__(self, c_in: int, c_out: int) -> None:
        super().__init__()
        self.edges = _EdgeConvolution(c_in, c_out)
        self.attention_sharp = _Attention(c_out)
        self.attention_gentle = _Attention(c_out)
        self.join = Shared(2 * c_out, c_out)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        x = self.edges(x)
        sharp, gentle = sharp_and_gentle(x)
        return self.join(torch.cat([self.attention_sharp(x, sharp), self.attention_gentle(x, gentle)], dim=2))


class GDANet(nn.Module):
    """GDANet for classification; `n_points` decides nothing, any number of points from 15 will do."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.first = _Block(3, 64)
        self.second = _Block(3 + 64, 64)
        self.third = nn.Sequential(_EdgeConvolution(3 + 64 + 64, 128), Shared(128, 128))
        self.points = Shared(64 + 64 + 128, 512)
        self.cloud = nn.Sequential(
            Shared(1024, 512), nn.Dropout(_DROPOUT), Shared(512, 256), nn.Dropout(_DROPOUT), nn.Linear(256, n_classes)
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) centred points in any order → (B, n_classes) logits."""
        first = self.first(points)
        known = torch.cat([points, first], dim=2)
        second = self.second(known)
        third = self.third(torch.cat([known, second], dim=2))
        x = self.points(torch.cat([first, second, third], dim=2))
        return self.cloud(torch.cat([x.amax(dim=1), x.mean(dim=1)], dim=1))
