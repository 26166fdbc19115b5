"""6-DOF GraspNet's evaluator: PointNet++ on the object's points joined with points of the gripper at the grasp.

Source: Mousavian, Eppner, Fox, ICCV 2019: the gripper's points, where the grasp has them, are joined with
the object's, each with a flag that says whose it is; the network says how likely the grasp holds.

Left open or other here: no hard negatives are made of good grasps by moving them, since the labels have failures of
grasps that a planner proposes; see `pointnet2_features` for the sizes.

At 1,024 points and share 1: 1.93 M parameters, 143.5 M multiply-adds; at 128 points and share 0.25: 0.12 M, 1.4 M.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.grasps.hand import Hand
from pec.grasps.networks.pointnet2_features import PointNet2Features
from pec.grasps.views import GraspViews

__all__ = ["GraspNetEvaluator"]


class GraspNetEvaluator(nn.Module):
    """The first `n_points` of a cloud, and 16 of the hand."""

    uses_normals = False

    def __init__(self, hand: Hand, n_points: int = 128, share: float = 0.5) -> None:
        super().__init__()
        self.hand, self.n_points = hand, n_points
        self.features = PointNet2Features(1, share)
        self.held = nn.Linear(self.features.width, 1)

    def forward(self, views: GraspViews) -> torch.Tensor:
        """B views → (B,) logits of being held."""
        cloud = views.points[:, : self.n_points]
        pose = views.T_cloud_grasp
        outline = self.hand.outline().to(cloud) @ pose[:, :3, :3].transpose(1, 2) + pose[:, None, :3, 3]
        points = torch.cat([cloud, outline], dim=1) - cloud.mean(dim=1, keepdim=True)
        whose = torch.zeros_like(points[..., :1])
        whose[:, cloud.shape[1] :] = 1.0
        return self.held(self.features(points, whose))[:, 0]
