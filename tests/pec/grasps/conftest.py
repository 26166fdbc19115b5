"""Bars on a table that hold wherever they are closed on across and not along: labels that anyone can learn."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pec.data.shards import Manifest, shard_name, write_manifest
from pec.grasps.labels import GraspScene, write_grasp_shard

INSTANCES = 8


def bar(rng: np.random.Generator, length: float, width: float) -> np.ndarray:
    """(300, 3) points of the top of a bar along x, 30 mm high."""
    across = rng.uniform(-0.5, 0.5, (300, 2)) * (length, width)
    return np.column_stack([across, np.full(300, 0.03)]).astype(np.float32)


def downward(yaw: float, at: np.ndarray) -> np.ndarray:
    """(4, 4) straight down, closing at an angle (rad) from x."""
    pose = np.eye(4)
    pose[:3, 0] = np.cos(yaw), np.sin(yaw), 0.0
    pose[:3, 2] = 0.0, 0.0, -1.0
    pose[:3, 1] = np.cross(pose[:3, 2], pose[:3, 0])
    pose[:3, 3] = at
    return pose


def scene(rng: np.random.Generator, instance: int) -> GraspScene:
    length, width = 0.10 + 0.004 * instance, 0.02 + 0.002 * instance
    along = np.arange(12) % 2 == 0
    yaws = np.where(along, 0.0, np.pi / 2) + rng.uniform(-0.2, 0.2, 12)
    places = np.column_stack([rng.uniform(-0.03, 0.03, 12), np.zeros(12), np.full(12, 0.035)])
    poses = np.array([downward(yaw, at) for yaw, at in zip(yaws, places, strict=True)])
    n = len(poses)
    return GraspScene(
        "bar",
        str(instance),
        bar(rng, length, width),
        np.eye(4),
        np.eye(4),
        poses.astype(np.float32),
        np.full(n, width, np.float32),
        np.full(n, 0.14, np.float32),
        np.zeros(n, np.uint8),
        np.where(along, 1, 0).astype(np.uint8),
    )


@pytest.fixture(scope="session", name="downward")
def downward_function() -> Callable[[float, np.ndarray], np.ndarray]:
    return downward


@pytest.fixture(scope="session")
def labels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four scenes of each of eight bars, twelve grasps a scene, half of which held."""
    directory, rng = tmp_path_factory.mktemp("bars"), np.random.default_rng(0)
    scenes = [scene(rng, instance) for _ in range(4) for instance in range(INSTANCES)]
    record = write_grasp_shard(directory / shard_name(0, ".npz"), scenes)
    instances = [{"name": str(i), "class": "bar"} for i in range(INSTANCES)]
    config = {"samplers": ["across and along"], "outcomes": ["held", "not lifted"]}
    write_manifest(directory, Manifest(["bar"], instances, [], config, 0, {}, [record], complete=True))
    return directory


@pytest.fixture
def settings(labels: Path, tmp_path: Path) -> dict:
    """Of the smallest run that learns."""
    return {
        "dataset": {"path": str(labels)},
        "network": {"cloud_points": 128, "n_points": 32, "image_size": 16, "share": 0.125},
        "protocol": {"epochs": 4, "batch_size": 32, "learning_rate": 0.01},
        "output": str(tmp_path / "run"),
        "device": "cpu",
        "progress": False,
    }
