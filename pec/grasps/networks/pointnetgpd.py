"""PointNetGPD: a PointNet on the points between the fingers, in the grasp's frame.

Source: Liang, Ma, Li, Görner, Tang, Fang, Sun, Zhang, "PointNetGPD: Detecting Grasp Configurations from Point Sets",
ICRA 2019: points inside the gripper's closing area, transformed to the gripper's frame, 750 of them, through a PointNet
with an input transform: 64, 128, 1024, maximum, 512, 256, classes.

Left open or other here: one logit (held or not) stands for two classes; `share` of the published widths, so that a CPU
trains it; metres in half strokes; 128 points, since our clouds are of one thing half a metre away.

At 750 points and share 1: 1.60 M parameters, 210.5 M multiply-adds; at 128 points and share 0.25: 0.10 M, 2.3 M.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.grasps.hand import Hand
from pec.grasps.views import GraspViews, between_fingers, first_of, in_grasp_frame, unless_nothing
from pec.networks.baselines.layers import Shared, shared_mlp
from pec.networks.baselines.pointnet import Transform

__all__ = ["PointNetGPD"]


class PointNetGPD(nn.Module):
    """`n_points` between the fingers decide nothing but the time; `share` of the published widths."""

    uses_normals = False

    def __init__(self, hand: Hand, n_points: int = 128, share: float = 0.25) -> None:
        super().__init__()
        self.hand, self.n_points = hand, n_points
        self.transform = Transform(3, share)
        widths = [round(share * width) for width in (64, 128, 1024, 512, 256)]
        self.points = shared_mlp(3, *widths[:3])
        self.cloud = nn.Sequential(Shared(*widths[2:4]), Shared(*widths[3:5]), nn.Linear(widths[4], 1))

    def forward(self, views: GraspViews) -> torch.Tensor:
        """B views → (B,) logits of being held."""
        local = in_grasp_frame(views.points, views.T_cloud_grasp)
        inside = between_fingers(local, self.hand)
        points = first_of(local, inside, self.n_points) / (0.5 * self.hand.stroke)
        features = self.points(points @ self.transform(points)).max(dim=1).values  # amax is slower to differentiate
        return unless_nothing(self.cloud(features)[:, 0], inside)
