"""The use of a trained pose network: the cloud of a known object in, the poses that it may have out."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
import torch

from pec.common.threads import torch_threads
from pec.errors import ConfigError
from pec.pose.checkpoint import PoseCheckpoint, read_pose_checkpoint
from pec.pose.clouds import sampled
from pec.pose.distance import PoseDistance
from pec.pose.hypotheses import Hypotheses, all_views

__all__ = ["PoseProposals", "PoseRegressor", "distinct"]

_SAME = 0.15  # radii of the model: proposals nearer than this end in the same place when they are refined


class PoseProposals(NamedTuple):
    """T_camera_object: (P, 4, 4) float64, m, the likeliest first. confidence: (P,) float64, their shares, sum ≤ 1."""

    T_camera_object: np.ndarray
    confidence: np.ndarray


class PoseRegressor:
    """Proposes poses of known models: `PoseRegressor.load(directory).propose(points, name)`.

    They are a start: ICP refines them, and a check against the cloud decides (`grasping.pose`).
    """

    def __init__(self, checkpoint: PoseCheckpoint) -> None:
        self._network, self._models = checkpoint.network.eval(), checkpoint.models
        self._distance = PoseDistance.of(self._models)

    @classmethod
    def load(cls, directory: str | os.PathLike[str]) -> PoseRegressor:
        """Load a checkpoint of `pecgrasp train-pose`. Raises CheckpointError where it is missing, broken or another."""
        return cls(read_pose_checkpoint(directory))

    @property
    def names(self) -> tuple[str, ...]:
        """The models that it knows, each as "class/instance"."""
        return self._models.names

    def propose(self, points: np.ndarray, name: str, most: int = 4) -> PoseProposals:
        """Up to `most` poses that the model `name` may have, from its cloud (N, 3) in metres, camera frame (OpenCV).

        Raises ModelsError for a model that it does not know, CloudError where the cloud is not finite (N ≥ 32, 3),
        ConfigError where `most` is not positive.
        """
        if most < 1:
            raise ConfigError(f"most must be at least 1, got {most}")
        model = torch.tensor([self._models.index(name)])
        cloud = torch.from_numpy(sampled(points, self._network.config.n_points))
        with torch.inference_mode(), torch_threads(1):
            said = all_views(self._network, self._distance, cloud[None], model)
            poses = said.poses(self._distance.centres[model])[0]
            kept, confidence = distinct(said, poses, self._distance, model, most)
        return PoseProposals(poses[kept].double().numpy(), confidence.double().numpy())


def distinct(
    said: Hypotheses, poses: torch.Tensor, distance: PoseDistance, model: torch.Tensor, most: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Of one cloud's hypotheses (1, K, …) with poses (K, 4, 4) those that differ: places (P,) and confidences (P,).

    The likeliest takes the confidence of all that are nearer to it than 0.15 radii, up to symmetry, then the likeliest
    of the rest does, and so on.
    """
    k = len(poses)
    apart = distance(said.centre.expand(k, -1, -1), said.rotation.expand(k, -1, -1, -1), poses, model.expand(k))
    share = said.confidence[0]
    same = apart < _SAME
    kept, confidence = [], []
    for _ in range(min(most, k)):
        best = int(share.argmax())
        if share[best] <= 0:
            break
        near = same[best] | (torch.arange(k) == best)
        kept.append(best)
        confidence.append(share[near].sum())
        share = share.masked_fill(near, 0.0)
    order = torch.stack(confidence).argsort(descending=True, stable=True)
    return torch.tensor(kept)[order], torch.stack(confidence)[order]
