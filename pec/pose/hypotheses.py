"""What the network says of clouds, back in their camera's frame."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch

from pec.pose.distance import PoseDistance
from pec.pose.network import PoseNetwork
from pec.pose.view_frame import N_VIEWS, principal_frame, sight_frame

__all__ = ["Hypotheses", "all_views", "hypotheses"]

_NEAR = 0.1  # radii: a hypothesis that is expected to be farther off by so much has a share e times smaller


class Hypotheses(NamedTuple):
    """centre (B, K, 3): of the model's points, camera frame, m. rotation (B, K, 3, 3) of T_camera_object. expected
    (B, K): how far from the truth the network expects it to be, in radii of the model."""

    centre: torch.Tensor
    rotation: torch.Tensor
    expected: torch.Tensor

    @property
    def confidence(self) -> torch.Tensor:
        """(B, K) shares of what is expected to be near."""
        return (-self.expected / _NEAR).softmax(dim=1)

    def poses(self, centres: torch.Tensor) -> torch.Tensor:
        """T_camera_object (B, K, 4, 4) of models with these centres (B, 3) in their own frames, m."""
        poses = torch.zeros(*self.centre.shape[:2], 4, 4, dtype=self.centre.dtype, device=self.centre.device)
        poses[..., :3, :3] = self.rotation
        poses[..., :3, 3] = self.centre - (self.rotation @ centres[:, None, :, None])[..., 0]
        poses[..., 3, 3] = 1.0
        return poses


def hypotheses(
    network: PoseNetwork, distance: PoseDistance, points: torch.Tensor, model: torch.Tensor, turn: torch.Tensor
) -> Hypotheses:
    """Of clouds (B, N, 3) in the camera frame, m, and their models (B,) int64.

    turn (B,) in [0, 1) chooses what the network's view frame leaves open: the angle about the line of sight, in turns,
    or one of the four views of the principal axes.
    """
    if network.frame == "sight":
        seen, T_camera_view = sight_frame(points, 2 * math.pi * turn)
    else:
        seen, T_camera_view = principal_frame(points, (N_VIEWS * turn).long())
    radius = distance.radii[model]
    rotation, position = T_camera_view[:, None, :3, :3], T_camera_view[:, None, :3, 3]
    sight = (torch.nn.functional.normalize(position, dim=2) @ rotation[:, 0])[:, 0]
    centre, turned, expected = network(seen / radius[:, None, None], sight, model)
    centre = (rotation @ (centre * radius[:, None, None])[..., None])[..., 0] + position
    return Hypotheses(centre, rotation @ turned, expected)


def all_views(network: PoseNetwork, distance: PoseDistance, points: torch.Tensor, model: torch.Tensor) -> Hypotheses:
    """As `hypotheses`, those of four views evenly apart, 4 K of them."""
    b = len(points)
    turn = torch.arange(N_VIEWS, device=points.device).repeat(b) / N_VIEWS
    said = hypotheses(network, distance, points.repeat_interleave(N_VIEWS, 0), model.repeat_interleave(N_VIEWS), turn)
    return Hypotheses(*(part.unflatten(0, (b, N_VIEWS)).flatten(1, 2) for part in said))
