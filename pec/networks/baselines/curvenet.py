"""CurveNet: from the points that matter most curves walk through the cloud, and every point learns from them.

Source: Xiang, Zhang, Song, Yu, Cai, "Walk in the Cloud: Learning Curves for Point Clouds Shape Analysis", ICCV 2021,
and the released configuration: stages of two blocks each, widths 64, 128, 256, 512, bottlenecks 1/2 and 1/4, at 1,024,
1,024, 256 and 64 points; in the first two stages 100 curves of 5 points in each block; 1,024, maximum and mean over the
points; 512, classes; leaky ReLU 0.2, dropout 0.5. At 40 classes 2,140,672 parameters, as the released network has.

Left open by the paper, or other here: it takes 20 neighbours at 1,024 points; at 64, 10, as DGCNN does. A tenth of the
points begin a curve. The shares of the points that later stages keep are its own (64, 64, 16, 4 of 64); their radii are
four times its own (0.4, 0.8), because the points of a surface lie four times as far apart, and in units of the cloud's
own radius: clouds come in metres.

At 64 points and 10 classes: 2.13 M parameters, 12.8 M multiply-adds.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pec.networks.baselines.layers import Shared
from pec.networks.baselines.neighbourhoods import farthest_points, nearest, take

__all__ = ["CurveNet"]

_K = 10  # neighbours
_SLOPE = 0.2
_EMBEDDING = 32
_STAGES = ((64, 1, True), (128, 1, True), (256, 1 / 4, False), (512, 1 / 16, False))  # width, points, with curves
_RADII = (0.4, 0.8)  # of the cloud's radius, where a stage keeps fewer points than the last
_CURVES = 0.1  # of the points begin one
_LENGTH = 5


def _surroundings(points: torch.Tensor, neighbours: torch.Tensor) -> torch.Tensor:
    """(B, N, k, 9): of each neighbour j of point i: p_i, p_j, p_j - p_i."""
    near = take(points, neighbours)
    centre = points[:, :, None].expand_as(near)
    return torch.cat([centre, near, near - centre], dim=3)


class _Linear(nn.Module):
    """(…, c_in) → (…, c_out): dense, no bias, batch norm, and no activation."""

    def __init__(self, c_in: int, c_out: int) -> None:
        super().__init__()
        self.linear = nn.Linear(c_in, c_out, bias=False)
        self.norm = nn.BatchNorm1d(c_out)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.norm(self.linear(x).flatten(0, -2)).view(*x.shape[:-1], -1)


class _Walk(nn.Module):
    """Curves (B, n, _LENGTH, c) through features x (B, N, c), each step to one of the neighbours (B, N, k)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.importance = nn.Linear(width, 1, bias=False)
        self.agent = _Linear(2 * width, 1)
        self.momentum = _Linear(2 * width, 2)

    def forward(self, x: torch.Tensor, neighbours: torch.Tensor) -> torch.Tensor:
        importance = torch.sigmoid(self.importance(x))
        x = x * importance
        place = importance[..., 0].topk(max(round(_CURVES * x.shape[1]), 1), dim=1).indices
        here = so_far = take(x, place)
        curve: list[torch.Tensor] = []
        for _ in range(_LENGTH):
            if curve:
                share = self.momentum(torch.cat([here, so_far], dim=2)).softmax(dim=2)
                so_far = share[..., :1] * here + share[..., 1:] * so_far
            onward = take(neighbours, place)
            options = take(x, onward)
            score = self.agent(torch.cat([options, so_far[:, :, None].expand_as(options)], dim=3))[..., 0]
            if curve:
                score = score * self._forward(here - so_far, options - here[:, :, None])
            here, choice = self._taken(score, options)
            place = onward.gather(2, choice[..., None])[..., 0]
            curve.append(here)
        return torch.stack(curve, dim=2)

    @staticmethod
    @torch.no_grad()
    def _forward(last: torch.Tensor, steps: torch.Tensor) -> torch.Tensor:
        """1 for a step that goes on, less for one that turns back, 0 for straight back: no curve crosses itself."""
        return (1 + functional.cosine_similarity(last[:, :, None], steps, dim=3)).clamp(0, 1)

    @staticmethod
    def _taken(score: torch.Tensor, options: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The option of the highest score, with the gradient of a softmax, and which it is."""
        soft = score.softmax(dim=2)
        choice = soft.argmax(dim=2)
        hard = functional.one_hot(choice, score.shape[2]) - soft.detach() + soft
        return (options * hard[..., None]).sum(dim=2), choice


class _Aggregation(nn.Module):
    """x (B, N, c) and curves (B, n, l, c) → (B, N, c): every point attends to the curves, and to their steps."""

    def __init__(self, width: int) -> None:
        super().__init__()
        half = width // 2
        self.weight = nn.Linear(width, 1, bias=False)
        self.query = nn.Linear(width, half, bias=False)
        self.of_curves, self.value_of_curves = nn.Linear(width, half, bias=False), nn.Linear(half, half, bias=False)
        self.of_steps, self.value_of_steps = nn.Linear(width, half, bias=False), nn.Linear(half, half, bias=False)
        self.join = _Linear(2 * half, width)

    def forward(self, x: torch.Tensor, curves: torch.Tensor) -> torch.Tensor:
        weight, query = self.weight(curves), self.query(x)
        each_curve = self.of_curves((curves * weight.softmax(dim=2)).sum(dim=2))
        each_step = self.of_steps((curves * weight.softmax(dim=1)).sum(dim=1))
        of_curves = (query @ each_curve.transpose(1, 2)).softmax(dim=2) @ self.value_of_curves(each_curve)
        of_steps = (query @ each_step.transpose(1, 2)).softmax(dim=2) @ self.value_of_steps(each_step)
        return functional.leaky_relu(x + self.join(torch.cat([of_curves, of_steps], dim=2)), _SLOPE)


class _Block(nn.Module):
    """Points (B, N, 3) and features (B, N, c_in) → (B, N, c_out): curves, then the mean over the neighbours, about a
    shortcut."""

    def __init__(self, c_in: int, c_out: int, bottleneck: int, *, curves: bool) -> None:
        super().__init__()
        width = c_in // bottleneck
        self.narrow = Shared(c_in, width, bias=False, slope=_SLOPE)
        self.walk = _Walk(width) if curves else None
        self.aggregation = _Aggregation(width) if curves else None
        self.position = _Linear(9, width)
        self.edges = Shared(width, width, bias=False, slope=_SLOPE)
        self.wide = _Linear(width, c_out)
        self.shortcut = _Linear(c_in, c_out) if c_in != c_out else nn.Identity()

    def forward(self, points: torch.Tensor, features: torch.Tensor) -> torch.Tensor:
        x = self.narrow(features)
        _, neighbours = nearest(points, points, _K + 1)  # the first is the point itself
        if self.walk is not None and self.aggregation is not None:
            x = self.aggregation(x, self.walk(x, neighbours[..., 1:]))
        near = neighbours[..., :_K]
        edges = take(x, near) - x[:, :, None] + self.position(_surroundings(points, near))
        x = self.edges(functional.leaky_relu(edges, _SLOPE)).mean(dim=2)
        return functional.leaky_relu(self.wide(x) + self.shortcut(features), _SLOPE)


class CurveNet(nn.Module):
    """CurveNet for clouds of at least 16 points; `n_points` decides nothing."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.embed = Shared(9, _EMBEDDING, bias=False, slope=_SLOPE)
        self.blocks = nn.ModuleList()
        c_in = _EMBEDDING
        for width, _, curves in _STAGES:
            self.blocks += [_Block(c_in, width, 2, curves=curves), _Block(width, width, 4, curves=curves)]
            c_in = width
        self.points = Shared(c_in, 1024, bias=False)
        self.cloud = nn.Sequential(Shared(2048, 512, bias=False), nn.Dropout(0.5), nn.Linear(512, n_classes))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) centred points in any order → (B, n_classes) logits."""
        n = points.shape[1]
        points = take(points, farthest_points(points, n))
        radius = points.square().sum(dim=2).amax(dim=1).sqrt()[:, None, None]
        _, near = nearest(points, points, _K)
        x = self.embed(_surroundings(points, near)).amax(dim=2)
        radii = iter(_RADII)
        for stage, (_, share, _) in enumerate(_STAGES):
            n_kept = max(int(share * n), 1)
            if n_kept < points.shape[1]:
                points, x = _fewer(points, x, n_kept, next(radii) * radius)
            for block in self.blocks[2 * stage : 2 * stage + 2]:
                x = block(points, x)
        x = self.points(x)
        return self.cloud(torch.cat([x.amax(dim=1), x.mean(dim=1)], dim=1))


def _fewer(
    points: torch.Tensor, features: torch.Tensor, n_kept: int, radius: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """The first points (B, n_kept, 3), and of each the maximum of the features within `radius` (B, 1, 1)."""
    squared, members = nearest(points[:, :n_kept], points, _K)
    members = torch.where(squared <= radius.square(), members, members[..., :1])
    return points[:, :n_kept], take(features, members).amax(dim=2)
