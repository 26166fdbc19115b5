"""SLNet-S: coordinates embedded without weights, then small residual MLPs on neighbourhoods, in four stages.

Source: Saeid, Salarpour, MohajerAnsari, Pesé, "SLNet: A Super-Lightweight Geometry-Adaptive Network for 3D Point Cloud
Recognition", ICRA 2026, and the released configuration: embedding 16, widths 32, 64, 128, 128; residual blocks before
and after the maximum 1, 1, 2, 1; bottleneck 1/4; every stage halves the points; 128, 64, classes. At 40 classes 140,488
parameters, 0.14 M as the paper counts; the released network has 504 more, factors after each normalisation whose
product it does not use.

Left open by the paper, or other here: 32 neighbours at 1,024 points, at 64 (32, 16, 8, 4 centres) 16 or all of fewer.
The embedding is laid out for the unit sphere, so coordinates are divided by the cloud's own radius. Every neighbourhood
is divided by its own spread, too: this network sees shape only, of size nothing.

At 64 points and 10 classes: 0.14 M parameters, 8.3 M multiply-adds.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import nn

from pec.networks.baselines.layers import Residual, Shared
from pec.networks.baselines.neighbourhoods import farthest_points, nearest, take

__all__ = ["SLNetS"]

_EMBEDDING = 16
_STAGES = ((32, 1), (64, 1), (128, 2), (128, 1))  # width, residual blocks before and after the maximum
_K = 16
_WIDTH = 0.4  # of a Gaussian, where a cloud has no spread
_COSINES_BELOW = 0.1  # spread from which on the Gaussians outweigh the cosines
_STEEPNESS = 10.0  # of that change
_EPSILON = 1e-5


class _Embedding(nn.Module):
    """(B, N, 3) in the unit sphere → (B, N, 16): how near each coordinate is to fixed values; then a factor and a shift
    for each channel, which are all there is to learn."""

    places: torch.Tensor
    chosen: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        n_places = math.ceil(_EMBEDDING / 3)
        # Derived, so in no checkpoint.
        self.register_buffer("places", torch.linspace(-1, 1, n_places + 2)[1:-1], persistent=False)
        self.register_buffer("chosen", torch.linspace(0, 3 * n_places - 1, _EMBEDDING).long(), persistent=False)
        self.scale = nn.Parameter(torch.ones(_EMBEDDING))
        self.shift = nn.Parameter(torch.zeros(_EMBEDDING))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        spread = points.std(dim=1).mean(dim=1)[:, None, None, None]
        offset = (points[..., None] - self.places) / (_WIDTH * (1 + spread))
        gaussians = torch.sigmoid(_STEEPNESS * (spread - _COSINES_BELOW))
        near = gaussians * (-0.5 * offset.square()).exp() + (1 - gaussians) * offset.cos()
        return near.flatten(2)[..., self.chosen] * self.scale + self.shift


class _Stage(nn.Module):
    """Points (B, N, 3) and features (B, N, c_in) → features (B, M, c_out) of M centres, which are among the points."""

    def __init__(self, c_in: int, c_out: int, n_blocks: int) -> None:
        super().__init__()
        self.enter = Shared(2 * c_in + 3, c_out, bias=False)
        self.before = nn.Sequential(*(Residual(c_out) for _ in range(n_blocks)))
        self.after = nn.Sequential(*(Residual(c_out) for _ in range(n_blocks)))

    def forward(self, points: torch.Tensor, features: torch.Tensor, n_centres: int) -> torch.Tensor:
        # The centres are the first points: see farthest_points.
        _, members = nearest(points[:, :n_centres], points, _K)
        known = torch.cat([features, points], dim=2)
        offset = take(known, members) - known[:, :n_centres, None]
        offset = offset / (offset.flatten(2).std(dim=2)[:, :, None, None] + _EPSILON)
        centre = features[:, :n_centres, None].expand(-1, -1, members.shape[2], -1)
        x = self.enter(torch.cat([offset, centre], dim=3))
        return self.after(self.before(x).amax(dim=2))


class SLNetS(nn.Module):
    """SLNet-S for clouds of `n_points` points, 16 or more."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.embed = _Embedding()
        widths = [_EMBEDDING, *(width for width, _ in _STAGES)]
        self.stages = nn.ModuleList(
            _Stage(c_in, c_out, n_blocks)
            for (c_in, c_out), (_, n_blocks) in zip(itertools.pairwise(widths), _STAGES, strict=True)
        )
        self.cloud = nn.Sequential(
            Shared(widths[-1], 128), nn.Dropout(0.5), Shared(128, 64), nn.Dropout(0.5), nn.Linear(64, n_classes)
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, n_points, 3) centred points in any order → (B, n_classes) logits."""
        n = points.shape[1]
        radius = points.square().sum(dim=2).amax(dim=1).sqrt()[:, None, None]
        points = take(points, farthest_points(points, n)) / radius.clamp_min(1e-9)
        features = self.embed(points)
        for stage in self.stages:
            n //= 2
            features = stage(points, features, n)
            points = points[:, :n]
        return self.cloud(features.amax(dim=1))
