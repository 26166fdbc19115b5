"""Two things that are easy to tell how they lie, seen from one side, in the product's own format."""

from pathlib import Path

import numpy as np
import pytest

from pec.data.shards import CloudSample, Manifest, shard_name, write_manifest, write_shard
from pec.pose.models import PoseModels, write_models

NAMES = ("hook/ell", "can/tin")
ORIGIN = np.array([0.01, -0.02, 0.03], np.float32)  # of the hook's model frame in the frame of its clouds' poses


def about_z(angles: np.ndarray) -> np.ndarray:
    """(A, 4, 4) turns about the z axis."""
    turns = np.tile(np.eye(4), (len(angles), 1, 1))
    turns[:, 0, 0], turns[:, 0, 1] = np.cos(angles), -np.sin(angles)
    turns[:, 1, 0], turns[:, 1, 1] = np.sin(angles), np.cos(angles)
    return turns


def random_pose(rng: np.random.Generator) -> np.ndarray:
    """(4, 4), some 0.6 m in front of the camera."""
    pose = np.eye(4)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose[:3, :3] = q * np.sign(np.linalg.det(q))
    pose[:3, 3] = rng.uniform([-0.15, -0.1, 0.5], [0.15, 0.1, 0.7])
    return pose


@pytest.fixture(scope="session")
def models() -> PoseModels:
    """An L of three different legs, which has one pose only, and a cylinder, any turn of which about z is alike."""
    rng = np.random.default_rng(0)
    legs = [(0.10, (0, 0.02, 0)), (0.06, (0.05, 0.0, 0.0)), (0.04, (0, 0, 0.03))]
    ell = [
        rng.uniform(-0.5, 0.5, (200, 3)) * np.roll([0.012, length, 0.012], k) + at
        for k, (length, at) in enumerate(legs)
    ]
    angle, height = rng.uniform(0, 2 * np.pi, 600), rng.uniform(-0.05, 0.05, 600)
    tin = np.column_stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), height])
    spins = about_z(np.deg2rad(np.arange(0, 360, 10)))
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    return PoseModels(
        NAMES,
        np.stack([np.concatenate(ell), tin]).astype(np.float32),
        (np.eye(4, dtype=np.float32)[None], np.concatenate([spins, spins @ flip]).astype(np.float32)),
        np.stack([ORIGIN, np.zeros(3)]).astype(np.float32),
    )


def seen(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The half of the model's points (P, 3) that is nearer to the camera, camera frame."""
    there = points @ pose[:3, :3].T + pose[:3, 3]
    distance = np.linalg.norm(there, axis=1)
    return there[distance < np.median(distance)].astype(np.float32)


@pytest.fixture(scope="session")
def data(models: PoseModels, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of 24 clouds of each of the two, and models.safetensors beside it."""
    directory, rng = tmp_path_factory.mktemp("posed"), np.random.default_rng(1)
    samples = []
    for i in range(48):
        m, pose = i % 2, random_pose(rng)
        label = pose.copy()  # of the frame whose origin the model's frame has at `origins`
        label[:3, 3] -= pose[:3, :3] @ models.origins[m]
        samples.append(CloudSample(seen(models.points[m], pose), m, m, label, i))
    record = write_shard(directory / shard_name(0), samples)
    instances = [dict(zip(("class", "name"), name.split("/"), strict=True)) for name in NAMES]
    classes = [name.split("/")[0] for name in NAMES]
    write_manifest(directory, Manifest(classes, instances, [{"name": "any"}], {}, 0, {}, [record], complete=True))
    write_models(directory / "models.safetensors", models)
    return directory


@pytest.fixture
def settings(data: Path, tmp_path: Path) -> dict:
    return {
        "dataset": {"path": str(data)},
        "models": str(data / "models.safetensors"),
        "output": str(tmp_path / "run"),
        "network": {"n_points": 32, "hypotheses": 2},
        "protocol": {"epochs": 3, "batch_size": 16},
        "progress": False,
    }
