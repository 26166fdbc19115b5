"""The PointNet++ that 6-DOF GraspNet's three networks are made of.

Source: Mousavian, Eppner, Fox, "6-DOF GraspNet: Variational Grasp Generation for Object Manipulation", ICCV 2019, and
its public code: of 1,024 points SA(128 centres, 0.02 m, 64 points, [64, 64, 128]) → SA(32, 0.04 m, 128, [128, 128,
256]) → SA([256, 256, 512]) → FC(1024) → FC(1024).

Other here, so that a CPU trains it: of 128 points a quarter and a sixteenth are centres, the radii are doubled, because
the points lie further apart, a ball holds the 16 nearest points, and the widths are a `share` of those.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.layers import shared_mlp
from pec.networks.baselines.neighbourhoods import balls, farthest_points, take

__all__ = ["PointNet2Features"]

_SHARES = (1 / 4, 1 / 16)  # of the points are centres
_RADII = (0.04, 0.08)  # m
_BALL = 16  # points at most


class PointNet2Features(nn.Module):
    """(B, N, 3) points, m, and (B, N, c_in) features of them → (B, width)."""

    def __init__(self, c_in: int, share: float) -> None:
        super().__init__()
        w = [round(share * width) for width in (64, 128, 256, 512, 1024)]
        self.width = w[4]
        levels = [shared_mlp(3 + c_in, w[0], w[0], w[1]), shared_mlp(3 + w[1], w[1], w[1], w[2])]
        self.levels = nn.ModuleList(levels)
        self.rest = shared_mlp(3 + w[2], w[2], w[2], w[3])
        self.cloud = shared_mlp(w[3], w[4], w[4])

    def forward(self, points: torch.Tensor, features: torch.Tensor) -> torch.Tensor:
        n_centres = [max(1, int(share * points.shape[1])) for share in _SHARES]
        chosen = take(points, farthest_points(points, n_centres[0]))
        for n, radius, level in zip(n_centres, _RADII, self.levels, strict=True):
            centres = chosen[:, :n]
            groups = balls(centres, points, features, radius, _BALL)
            points, features = centres, level(groups).max(dim=2).values
        return self.cloud(self.rest(torch.cat([points, features], dim=2)).max(dim=1).values)
