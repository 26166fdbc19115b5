"""Grasp labels as tensors: each scene's cloud once, and of each grasp its scene, its pose and whether it held."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import torch

from pec.errors import DatasetError
from pec.grasps.clouds import FEWEST_POINTS, spread_points, surface_normals
from pec.grasps.labels import GraspLabels
from pec.grasps.network import NetworkConfig
from pec.grasps.training.config import GraspAugment, GraspDataConfig
from pec.grasps.views import GraspViews

__all__ = ["GraspTensors", "Splits", "load_splits"]

_HALF_TURN = (-1.0, -1.0, 1.0)  # of the hand about its approach: the same grasp


@dataclass(frozen=True)
class GraspTensors:
    """points, normals: (S, N, 3) float32, world frame, m, a row a scene. T_world_grasp (G, 4, 4) float32, scene_of (G,)
    int64, held (G,) bool and sampler (G,) int64: a row a grasp. instances: S names."""

    points: torch.Tensor
    normals: torch.Tensor
    T_world_grasp: torch.Tensor
    scene_of: torch.Tensor
    held: torch.Tensor
    sampler: torch.Tensor
    instances: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.held)

    def to(self, device: torch.device) -> GraspTensors:
        return GraspTensors(
            self.points.to(device),
            self.normals.to(device),
            self.T_world_grasp.to(device),
            self.scene_of.to(device),
            self.held.to(device),
            self.sampler.to(device),
            self.instances,
        )

    def only(self, chosen: torch.Tensor) -> GraspTensors:
        """The grasps at an index or mask; all scenes stay."""
        return GraspTensors(
            self.points,
            self.normals,
            self.T_world_grasp[chosen],
            self.scene_of[chosen],
            self.held[chosen],
            self.sampler[chosen],
            self.instances,
        )

    def views(self, index: torch.Tensor) -> GraspViews:
        """The grasps at an index (B,), each with its cloud."""
        scene = self.scene_of[index]
        return GraspViews(self.points[scene], self.normals[scene], self.T_world_grasp[index])

    def drawn_views(self, index: torch.Tensor, augment: GraspAugment) -> GraspViews:
        """The same, damaged and turned as `augment` says; draws from torch's generator."""
        points, normals, poses = self.views(index)
        device = points.device
        points = points + augment.jitter * torch.randn(points.shape).to(device)
        # A hand turned half round its approach is the same hand.
        signs = torch.where(torch.rand(len(index), 1) < 0.5, torch.tensor(_HALF_TURN), torch.ones(3))
        poses = poses.clone()
        poses[:, :3, :3] *= signs.to(device)[:, None]
        if augment.yaw:
            turn = _about_z(2 * torch.pi * torch.rand(len(index))).to(device)
            points, normals = points @ turn.transpose(1, 2), normals @ turn.transpose(1, 2)
            poses[:, :3] = turn @ poses[:, :3]
        return GraspViews(points, normals, poses)


@dataclass(frozen=True)
class Splits:
    """No instance is in two of them. version: decided by the content of the labels."""

    training: GraspTensors
    validation: GraspTensors
    test: GraspTensors
    samplers: tuple[str, ...]
    version: str

    def to(self, device: torch.device) -> Splits:
        parts = (self.training.to(device), self.validation.to(device), self.test.to(device))
        return Splits(*parts, self.samplers, self.version)


def load_splits(settings: GraspDataConfig, network: NetworkConfig, normals: bool, seed: int) -> Splits:
    """The labels, split by instance; scenes of fewer than 10 points are passed over.

    Raises DatasetError where labels are missing or damaged, an outcome to pass over is none of theirs, or a part has no
    grasps of either kind.
    """
    labels = GraspLabels(settings.path)
    if unknown := set(settings.passed_over) - set(labels.outcomes):
        raise DatasetError(
            f"dataset.passed_over: {settings.path} has no outcome {', '.join(sorted(unknown))}; it has "
            f"{', '.join(labels.outcomes)}"
        )
    if "held" in settings.passed_over:
        raise DatasetError("dataset.passed_over: held is what is to be learnt")
    passed_over = [labels.outcomes.index(name) for name in settings.passed_over]
    training, rest = labels.split(settings.train_fraction, seed)
    others = np.random.default_rng(seed).permutation(sorted(rest)).tolist()
    if len(others) < 2:
        raise DatasetError(f"{settings.path}: {len(others)} instance is left to choose on and to test on, 2 are needed")
    parts = {"training": training, "validation": others[::2], "test": others[1::2]}
    tensors = {name: _tensors(labels, part, network, normals, passed_over) for name, part in parts.items()}
    for name, part in tensors.items():
        if not 0 < int(part.held.sum()) < len(part):
            raise DatasetError(
                f"{settings.path}: {int(part.held.sum())} of {len(part)} grasps for {name} held: both kinds are needed"
            )
    version = " ".join(record.sha256 for record in labels.manifest.shards)
    return Splits(**tensors, samplers=labels.samplers, version=version)


def _tensors(
    labels: GraspLabels, instances: Collection[str], network: NetworkConfig, normals: bool, passed_over: list[int]
) -> GraspTensors:
    no_cloud = torch.zeros(0, network.cloud_points, 3)
    clouds, turned, names = [no_cloud], [no_cloud], list[str]()
    poses, held = [np.zeros((0, 4, 4), np.float32)], [np.zeros(0, bool)]
    scene_of, sampler = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    for scene in labels.scenes(instances):
        kept = ~np.isin(scene.outcome, passed_over)
        if len(scene.points) < FEWEST_POINTS or not kept.any():
            continue
        points = torch.from_numpy(spread_points(scene.points, network.cloud_points))
        clouds.append(points[None])
        turned.append((surface_normals(points) if normals else torch.zeros_like(points))[None])
        scene_of.append(np.full(int(kept.sum()), len(names)))
        names.append(scene.thing)
        poses.append(scene.T_world_grasp[kept])
        held.append(scene.held[kept])
        sampler.append(scene.sampler[kept].astype(np.int64))
    return GraspTensors(
        torch.cat(clouds),
        torch.cat(turned),
        torch.from_numpy(np.concatenate(poses)),
        torch.from_numpy(np.concatenate(scene_of)),
        torch.from_numpy(np.concatenate(held)),
        torch.from_numpy(np.concatenate(sampler)),
        tuple(names),
    )


def _about_z(angle: torch.Tensor) -> torch.Tensor:
    """(B,) rad → (B, 3, 3)."""
    cos, sin, zero, one = angle.cos(), angle.sin(), torch.zeros_like(angle), torch.ones_like(angle)
    return torch.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], dim=1).unflatten(1, (3, 3))
