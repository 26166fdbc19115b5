"""PointMLP-elite: residual MLPs on neighbourhoods that are brought to one scale, in four stages.

Source: Ma, Qin, You, Ran, Fu, "Rethinking Network Design and Local Geometry in Point Cloud: A Simple Residual MLP
Framework", ICLR 2022, sections 3.1-3.3 and the released configuration: embedding 32; widths 64, 128, 256, 256; blocks
before and after the maximum 1, 1, 2, 1; bottleneck 1/4; every stage halves the points. At 40 classes 716,232
parameters, the 0.72 M that later papers count; the paper's table says 0.68 M, which this configuration does not give.

Left open by the paper, or other here: it takes 24 neighbours at 1,024 points; at 64 (32, 16, 8, 4 centres) 12 or, in
the last stage, all 8. The spread that divides a neighbourhood is taken over each cloud, as in the corrected code.

At 64 points and 10 classes: 0.71 M parameters, 26.0 M multiply-adds.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.layers import Residual, Shared
from pec.networks.baselines.neighbourhoods import farthest_points, nearest, take

__all__ = ["PointMLPElite"]

_EMBEDDING = 32
_STAGES = ((64, 1), (128, 1), (256, 2), (256, 1))  # width, residual blocks before and after the maximum
_K = 12
_EPSILON = 1e-5


class _Stage(nn.Module):
    """Points (B, N, 3) and features (B, N, c_in) → features (B, M, c_out) of M centres, which are among the points."""

    def __init__(self, c_in: int, c_out: int, n_blocks: int) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.ones(c_in))
        self.shift = nn.Parameter(torch.zeros(c_in))
        self.enter = Shared(2 * c_in, c_out, bias=False)
        self.before = nn.Sequential(*(Residual(c_out) for _ in range(n_blocks)))
        self.after = nn.Sequential(*(Residual(c_out) for _ in range(n_blocks)))

    def forward(self, points: torch.Tensor, features: torch.Tensor, n_centres: int) -> torch.Tensor:
        # The centres are the first points: see farthest_points.
        _, members = nearest(points[:, :n_centres], points, _K)
        centre = features[:, :n_centres, None]
        offset = take(features, members) - centre
        offset = offset / (offset.flatten(1).std(dim=1)[:, None, None, None] + _EPSILON)
        offset = offset * self.scale + self.shift
        x = self.enter(torch.cat([offset, centre.expand_as(offset)], dim=3))
        return self.after(self.before(x).amax(dim=2))


class PointMLPElite(nn.Module):
    """PointMLP-elite for clouds of `n_points` points, 16 or more."""

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.embed = Shared(3, _EMBEDDING, bias=False)
        widths = [_EMBEDDING, *(width for width, _ in _STAGES)]
        self.stages = nn.ModuleList(
            _Stage(c_in, c_out, n_blocks) for c_in, (c_out, n_blocks) in zip(widths[:-1], _STAGES, strict=True)
        )
        self.cloud = nn.Sequential(
            Shared(widths[-1], 512), nn.Dropout(0.5), Shared(512, 256), nn.Dropout(0.5), nn.Linear(256, n_classes)
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, n_points, 3) centred points in any order → (B, n_classes) logits."""
        n = points.shape[1]
        points = take(points, farthest_points(points, n))
        features = self.embed(points)
        for stage in self.stages:
            n //= 2
            features = stage(points, features, n)
            points = points[:, :n]
        return self.cloud(features.amax(dim=1))
