"""6-DOF GraspNet's sampler: a variational autoencoder of the grasps that hold, given the object's points.

Source: Mousavian, Eppner, Fox, "6-DOF GraspNet", ICCV 2019: encoder and decoder are PointNet++ with the grasp, or a
latent of two numbers, beside each point; the decoder gives a quaternion and a translation; the loss is the mean
distance of the gripper's points between the grasp and its reconstruction, plus 0.01 of the divergence of the latent
from a standard normal, from which latents are drawn later.

Left open or other here: a grasp turned half round its approach is the same one, and the nearer of both counts; the
distance is L1 over five points of the hand, in hundredths of a metre; see `pointnet2_features` for the sizes.

At 1,024 points and share 1: 3.86 M parameters, 141.5 M multiply-adds a grasp (the decoder alone); at 128 points and
share 0.5: 0.98 M, 4.8 M.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.grasps.hand import Hand
from pec.grasps.networks.pointnet2_features import PointNet2Features
from pec.grasps.views import GraspViews
from pec.pose.rotations import from_quaternion

__all__ = ["GraspNetSampler"]

LATENT = 2
DIVERGENCE = 0.01  # weight in the loss
_UNIT = 0.01  # m


class GraspNetSampler(nn.Module):
    """The first `n_points` of a cloud; `propose` draws grasps, `loss` is what training lowers."""

    uses_normals = False

    def __init__(self, hand: Hand, n_points: int = 128, share: float = 0.5) -> None:
        super().__init__()
        self.hand, self.n_points = hand, n_points
        self.encoder = PointNet2Features(12, share)
        self.posterior = nn.Linear(self.encoder.width, 2 * LATENT)
        self.decoder = PointNet2Features(LATENT, share)
        self.pose = nn.Linear(self.decoder.width, 7)
        with torch.no_grad():  # a quaternion begins well off zero
            self.pose.bias.copy_(torch.tensor([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))

    def loss(self, views: GraspViews) -> torch.Tensor:
        """Of B views of grasps that hold; draws from torch's generator."""
        cloud = views.points[:, : self.n_points]
        middle = cloud.mean(dim=1, keepdim=True)
        truth = views.T_cloud_grasp.clone()
        truth[:, :3, 3] -= middle[:, 0]
        grasp = torch.cat([truth[:, :3, :3].flatten(1), truth[:, :3, 3] / (10 * _UNIT)], dim=1)
        beside = grasp[:, None].expand(-1, cloud.shape[1], -1)
        mean, log_variance = self.posterior(self.encoder(cloud - middle, beside)).chunk(2, dim=1)
        log_variance = log_variance.clamp(-10.0, 10.0)
        latent = mean + torch.randn_like(mean) * (0.5 * log_variance).exp()
        said = self._decoded(cloud - middle, latent)
        divergence = 0.5 * (mean.square() + log_variance.exp() - 1.0 - log_variance).sum(dim=1)
        return (self._distance(said, truth) + DIVERGENCE * divergence).mean()

    def propose(self, points: torch.Tensor, latents: torch.Tensor) -> torch.Tensor:
        """T_cloud_grasp (G, 4, 4) of latents (G, 2) on one cloud (N, 3)."""
        cloud = points[: self.n_points]
        middle = cloud.mean(dim=0)
        poses = self._decoded((cloud - middle).expand(len(latents), -1, -1), latents)
        poses[:, :3, 3] += middle
        return poses

    def _decoded(self, centred: torch.Tensor, latent: torch.Tensor) -> torch.Tensor:
        features = self.decoder(centred, latent[:, None].expand(-1, centred.shape[1], -1))
        quaternion, translation = self.pose(features).split([4, 3], dim=1)
        poses = torch.eye(4, device=centred.device).repeat(len(latent), 1, 1)
        poses[:, :3, :3] = from_quaternion(quaternion)
        poses[:, :3, 3] = 10 * _UNIT * translation
        return poses

    def _distance(self, said: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """(B,) mean L1 distance of the hand's points, hundredths of a metre, of the nearer of a grasp's two turns."""
        points = self.hand.control_points().to(said)
        turned = points * torch.tensor([-1.0, -1.0, 1.0]).to(said)
        there = points @ said[:, :3, :3].transpose(1, 2) + said[:, None, :3, 3]
        gaps = []
        for each in (points, turned):
            true = each @ truth[:, :3, :3].transpose(1, 2) + truth[:, None, :3, 3]
            gaps.append((there - true).abs().sum(dim=2).mean(dim=1))
        return torch.minimum(*gaps) / _UNIT
