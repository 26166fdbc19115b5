"""The use of a trained evaluator: a cloud and grasps on it in, how likely each holds out."""

from __future__ import annotations

import os

import numpy as np
import torch

from pec.common.threads import torch_threads
from pec.errors import CheckpointError
from pec.grasps.checkpoint import GraspCheckpoint, read_grasp_checkpoint
from pec.grasps.clouds import spread_points, surface_normals
from pec.grasps.networks.graspnet_sampler import GraspNetSampler
from pec.grasps.views import GraspViews

__all__ = ["GraspScorer"]

_TOGETHER = 128  # grasps: bounds memory, changes no result


class GraspScorer:
    """`GraspScorer.load(directory)(cloud, poses, widths)`: what planners of `grasping` take as `scores` and `rerank`.

    A cloud and grasps in a frame whose z is up, as the labels were; the gripper that the checkpoint was trained with.
    """

    def __init__(self, checkpoint: GraspCheckpoint) -> None:
        if isinstance(checkpoint.network, GraspNetSampler):
            raise CheckpointError(f"a {checkpoint.config.name} proposes grasps and judges none: give an evaluator's")
        self.network, self.config = checkpoint.network.eval(), checkpoint.config

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> GraspScorer:
        """Load a checkpoint of `pecgrasp train-grasps`. Raises CheckpointError where it is missing or another."""
        return cls(read_grasp_checkpoint(directory))

    def __call__(self, cloud: np.ndarray, poses: np.ndarray, widths: np.ndarray) -> np.ndarray:
        """(G,) float64 in [0, 1] of grasps with poses (G, 4, 4) and widths (G,), m, which the networks do not look at,
        on the cloud (N, 3) of one object, m.

        Raises CloudError where the cloud is not finite (N ≥ 10, 3).
        """
        if not len(poses):
            return np.zeros(0)
        with torch.inference_mode(), torch_threads(1):
            points, normals = self.surface(cloud)
            grasps = torch.from_numpy(np.asarray(poses, np.float32))
            logits = [self.logits(points, normals, some) for some in grasps.split(_TOGETHER)]
            return torch.cat(logits).sigmoid().double().numpy()

    def surface(self, cloud: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        """Points and normals (n, 3) of a cloud (N, 3) as the network takes them."""
        points = torch.from_numpy(spread_points(cloud, self.config.cloud_points))
        return points, surface_normals(points) if self.network.uses_normals else torch.zeros_like(points)

    def logits(self, points: torch.Tensor, normals: torch.Tensor, poses: torch.Tensor) -> torch.Tensor:
        """(G,) of poses (G, 4, 4) float32 on what `surface` gave."""
        n = len(poses)
        return self.network(GraspViews(points.expand(n, -1, -1), normals.expand(n, -1, -1), poses))
