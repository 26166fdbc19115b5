"""The use of a trained sampler: an object's cloud in, grasps out, moved to where an evaluator likes them better.

Source: Mousavian, Eppner, Fox, "6-DOF GraspNet", ICCV 2019: ten steps along the gradient of the evaluator's probability
by the grasp's pose, none longer than a centimetre. The source scales the step of the whole pose by that; here turns are
besides no more than 0.1 rad a step.
"""

from __future__ import annotations

import os

import numpy as np
import torch

from pec.common.threads import torch_threads
from pec.errors import CheckpointError, ConfigError
from pec.grasps.checkpoint import GraspCheckpoint, read_grasp_checkpoint
from pec.grasps.clouds import spread_points
from pec.grasps.networks.graspnet_sampler import LATENT, GraspNetSampler
from pec.grasps.scorer import GraspScorer
from pec.pose.rotations import from_axis_angle

__all__ = ["GraspProposer"]

_LONGEST_STEP_M, _WIDEST_STEP_RAD = 0.01, 0.1
_SEED = 0  # of the latents, so that a cloud is given the same grasps again


class GraspProposer:
    """`GraspProposer.load(sampler, evaluator)(cloud)`: what `grasping.LearnedPlanner` takes as `propose`.

    scorer: None leaves the grasps where the sampler has them. n_grasps: drawn. steps: of refinement.
    """

    def __init__(
        self, sampler: GraspCheckpoint, scorer: GraspScorer | None = None, *, n_grasps: int = 100, steps: int = 10
    ) -> None:
        if not isinstance(sampler.network, GraspNetSampler):
            raise CheckpointError(f"a {sampler.config.name} judges grasps and proposes none: give a sampler's")
        for name, value, least in (("n_grasps", n_grasps, 1), ("steps", steps, 0)):
            if value < least:
                raise ConfigError(f"{name} must be {least} at least, got {value}")
        self._network, self._config = sampler.network.eval(), sampler.config
        self._scorer, self._steps = scorer, steps
        self._latents = torch.randn(n_grasps, LATENT, generator=torch.Generator().manual_seed(_SEED))

    @classmethod
    def load(
        cls,
        sampler: str | os.PathLike[str],
        evaluator: str | os.PathLike[str] | None = None,
        n_grasps: int = 100,
        steps: int = 10,
    ) -> GraspProposer:
        """From checkpoints of `pecgrasp train-grasps`. Raises CheckpointError where one is missing or another."""
        scorer = None if evaluator is None else GraspScorer.load(evaluator)
        return cls(read_grasp_checkpoint(sampler), scorer, n_grasps=n_grasps, steps=steps)

    def __call__(self, cloud: np.ndarray) -> np.ndarray:
        """(G, 4, 4) float64 poses of grasps on the cloud (N, 3) of one object, m, in a frame whose z is up.

        Raises CloudError where the cloud is not finite (N ≥ 10, 3).
        """
        with torch_threads(1):
            with torch.no_grad():
                points = torch.from_numpy(spread_points(cloud, self._config.cloud_points))
                poses = self._network.propose(points, self._latents)
            if self._scorer is not None and self._steps:
                poses = _refined(self._scorer, cloud, poses, self._steps)
            return poses.double().numpy()


def _refined(scorer: GraspScorer, cloud: np.ndarray, poses: torch.Tensor, steps: int) -> torch.Tensor:
    """The likeliest pose of each grasp's (G, 4, 4) way uphill."""
    points, normals = scorer.surface(cloud)
    best, most = poses, torch.full((len(poses),), -torch.inf)
    for step in range(steps + 1):
        move = torch.zeros(len(poses), 6, requires_grad=True)
        moved = _moved(poses, move)
        logits = scorer.logits(points, normals, moved)
        better = logits.detach() > most
        best = torch.where(better[:, None, None], poses, best)
        most = torch.maximum(most, logits.detach())
        if step == steps:
            break
        (slope,) = torch.autograd.grad(logits.sigmoid().sum(), move)
        with torch.no_grad():
            turn, shift = slope.split(3, dim=1)
            length = _LONGEST_STEP_M / shift.norm(dim=1, keepdim=True).clamp_min(1e-12)
            turn, shift = turn * length, shift * length
            turn = turn * (_WIDEST_STEP_RAD / turn.norm(dim=1, keepdim=True).clamp_min(_WIDEST_STEP_RAD))
            poses = _moved(poses, torch.cat([turn, shift], dim=1))
    return best


def _moved(poses: torch.Tensor, move: torch.Tensor) -> torch.Tensor:
    """Poses (G, 4, 4) turned about their own origins and shifted, both in the cloud's frame, by (G, 6): rad, m."""
    rotation = from_axis_angle(move[:, :3]) @ poses[:, :3, :3]
    translation = (poses[:, :3, 3] + move[:, 3:])[..., None]
    return torch.cat([torch.cat([rotation, translation], dim=2), poses[:, 3:]], dim=1)
