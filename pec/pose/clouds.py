"""Clouds with the poses that they were captured with: a generated data set as tensors, and what training draws."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from pec.data.augment import Augment, augment
from pec.data.shards import read_manifest, read_shard
from pec.errors import DatasetError
from pec.pose.models import PoseModels
from pec.preprocessing.preprocess import check_cloud, farthest_points

__all__ = ["FEWEST_POINTS", "PosedClouds", "load_posed_clouds", "network_inputs", "sampled"]

FEWEST_POINTS = 32
"""Of a cloud; one with fewer than the network takes gives some of its points twice."""

_SPARE = 2  # times the network's points, to draw other ones each epoch


@dataclass(frozen=True)
class PosedClouds:
    """points (n, K, 3) float32, camera frame, m. T_camera_object (n, 4, 4) float32, object frames as the models have
    them. model (n,) int64, of the models. occlusion (n,) float32: share of the object that others hide. version:
    decided by the content of the data set."""

    points: torch.Tensor
    T_camera_object: torch.Tensor
    model: torch.Tensor
    occlusion: torch.Tensor
    version: str

    def __len__(self) -> int:
        return len(self.model)

    def subset(self, index: torch.Tensor) -> PosedClouds:
        return PosedClouds(
            self.points[index], self.T_camera_object[index], self.model[index], self.occlusion[index], self.version
        )

    def to(self, device: torch.device) -> PosedClouds:
        points, poses = self.points.to(device), self.T_camera_object.to(device)
        return PosedClouds(points, poses, self.model.to(device), self.occlusion.to(device), self.version)


def load_posed_clouds(directory: str | os.PathLike[str], models: PoseModels, n_points: int) -> PosedClouds:
    """The clouds of a generated data set whose objects, "class/instance", are among the models.

    Each is left `2 n_points` points by farthest point sampling. Clouds of fewer than 32 points are passed over.
    Raises DatasetError where it is missing, unfinished or of other scales than the models, or a model has no cloud.
    """
    directory = Path(directory)
    manifest = read_manifest(directory)
    if not manifest.complete:
        raise DatasetError(f"{directory} is unfinished: run the same generation command again, it resumes")
    names = [f"{instance['class']}/{instance['name']}" for instance in manifest.instances]
    place = np.array([models.names.index(name) if name in models.names else -1 for name in names])
    points, poses, model, occlusion = [], [], [], []
    for record in manifest.shards:
        shard = read_shard(directory / record.file, record, mapped=True)
        for i in np.flatnonzero(place[shard.instance_index] >= 0):
            cloud = shard.cloud(int(i))
            if len(cloud) < FEWEST_POINTS:
                continue
            points.append(sampled(cloud, _SPARE * n_points))
            of = place[shard.instance_index[i]]
            pose = shard.T_camera_object[i].astype(np.float64)
            pose[:3, 3] += pose[:3, :3] @ models.origins[of]
            poses.append(pose.astype(np.float32))
            model.append(of)
            occlusion.append(shard.occlusion[i])
    missing = [name for i, name in enumerate(models.names) if i not in model]
    if missing:
        raise DatasetError(f"{directory} has no cloud of {missing[0]!r}; it has {', '.join(names)}")
    matrices = np.stack(poses)
    if not np.allclose(np.linalg.det(matrices[:, :3, :3]), 1.0, atol=1e-3):
        raise DatasetError(f"{directory}: its clouds were scaled, so no pose of a model of known size fits them")
    return PosedClouds(
        torch.from_numpy(np.stack(points)),
        torch.from_numpy(matrices),
        torch.tensor(np.array(model, np.int64)),
        torch.from_numpy(np.array(occlusion, np.float32)),
        " ".join(record.sha256 for record in manifest.shards),
    )


def sampled(cloud: np.ndarray, n: int) -> np.ndarray:
    """(n, 3) float32 points of a cloud (N, 3) where it lies, by farthest point sampling; all, some twice, where N < n.

    Raises CloudError where it is not finite (N ≥ 32, 3).
    """
    cloud = check_cloud(cloud, FEWEST_POINTS)
    chosen = min(n, len(cloud))
    centred = farthest_points(cloud, chosen, None)
    mean = np.ascontiguousarray(cloud).mean(axis=0, dtype=np.float64)
    return (centred + mean).astype(np.float32)[np.arange(n) % chosen]


def network_inputs(points: torch.Tensor, settings: Augment, n_points: int, generator: torch.Generator) -> torch.Tensor:
    """Of clouds (B, K, 3) a damaged draw (B, n_points, 3), all from `generator`."""
    valid = torch.ones(points.shape[:2], dtype=torch.bool, device=points.device)
    points, valid = augment(points, valid, settings, generator)
    keys = torch.rand(valid.shape, generator=generator, device=generator.device).to(points.device)
    order = keys.masked_fill(~valid, -1.0).argsort(dim=1, descending=True)
    there = valid.sum(dim=1, keepdim=True)
    index = order.gather(1, torch.arange(n_points, device=points.device)[None] % there)
    return points.gather(1, index[..., None].expand(-1, -1, 3))
