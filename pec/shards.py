"""The data set on disk: a manifest and shards of labelled clouds.

    DIR/manifest.json               what was generated, from what, by which versions; which shards exist
    DIR/shards/00000.safetensors    tensors of one shard:
        points           (M, 3) float32   every cloud of the shard, one after the other; camera frame (OpenCV), metres
        offsets          (n + 1,) int64   cloud i is points[offsets[i]:offsets[i + 1]]
        class_index      (n,) int32       into the manifest's `classes`
        instance_index   (n,) int32       into the manifest's `instances`
        T_camera_object  (n, 4, 4) float32
        seed             (n,) int64       the seed that drew the sample

A shard is written under a temporary name and renamed, and the manifest lists it only afterwards: whatever kills the
generator, what the manifest lists is whole.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from pec.errors import DatasetError

__all__ = [
    "MANIFEST_NAME",
    "SCHEMA_VERSION",
    "CloudSample",
    "Manifest",
    "Shard",
    "ShardRecord",
    "read_manifest",
    "read_shard",
    "shard_name",
    "write_manifest",
    "write_shard",
]

SCHEMA_VERSION = 1
MANIFEST_NAME = "manifest.json"
_DTYPES = {
    "points": np.float32,
    "offsets": np.int64,
    "class_index": np.int32,
    "instance_index": np.int32,
    "T_camera_object": np.float32,
    "seed": np.int64,
}


@dataclass(frozen=True)
class CloudSample:
    """One captured object: the cloud of its visible side and where it stood."""

    points: np.ndarray
    """(N, 3) metres, camera frame (OpenCV)."""
    class_index: int
    instance_index: int
    T_camera_object: np.ndarray
    """(4, 4), maps object frame to camera frame."""
    seed: int


@dataclass(frozen=True)
class Shard:
    """The arrays of one shard, as the module's docstring lists them."""

    points: np.ndarray
    offsets: np.ndarray
    class_index: np.ndarray
    instance_index: np.ndarray
    T_camera_object: np.ndarray
    seed: np.ndarray

    def __len__(self) -> int:
        return len(self.class_index)

    def cloud(self, index: int) -> np.ndarray:
        """The (N, 3) float32 points of sample `index`."""
        return self.points[self.offsets[index] : self.offsets[index + 1]]


@dataclass(frozen=True)
class ShardRecord:
    """A shard as the manifest lists it; `file` is relative to the data set's directory."""

    file: str
    n_samples: int
    sha256: str
    rejected: dict[str, int] = field(default_factory=dict)
    """Draws that gave no sample of this shard, counted by reason."""


@dataclass(frozen=True)
class Manifest:
    """What a data set is and what of it exists already."""

    classes: list[str]
    instances: list[dict[str, Any]]
    """One mapping an instance, with at least `name` and `class`."""
    config: dict[str, Any]
    """The resolved configuration that generated it."""
    seed: int
    generator: dict[str, str]
    """Name and version of the generator and of the packages that decide its output."""
    shards: list[ShardRecord] = field(default_factory=list)
    complete: bool = False
    schema_version: int = SCHEMA_VERSION


def shard_name(index: int) -> str:
    """The path of shard `index`, relative to the data set's directory: `shards/00000.safetensors`."""
    return f"shards/{index:05d}.safetensors"


def write_shard(path: str | os.PathLike[str], samples: Sequence[CloudSample]) -> ShardRecord:
    """Write `samples` as one shard, atomically, and return its record for the manifest.

    `path` must be `DIR/shards/NAME`; the record's `file` is relative to DIR. A cloud may be empty.
    Raises DatasetError where a cloud is not (N, 3) or not finite.
    """
    for index, sample in enumerate(samples):
        if sample.points.ndim != 2 or sample.points.shape[1] != 3 or not np.isfinite(sample.points).all():
            raise DatasetError(f"sample {index} for {path}: points must be finite (N, 3), got {sample.points.shape}")
    lengths = [len(sample.points) for sample in samples]
    clouds = [np.asarray(sample.points, np.float32) for sample in samples]
    tensors: dict[str, np.ndarray] = {
        "points": np.concatenate(clouds) if clouds else np.zeros((0, 3), np.float32),
        "offsets": np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        "class_index": np.array([sample.class_index for sample in samples], np.int32),
        "instance_index": np.array([sample.instance_index for sample in samples], np.int32),
        "T_camera_object": np.array([sample.T_camera_object for sample in samples], np.float32).reshape(-1, 4, 4),
        "seed": np.array([sample.seed for sample in samples], np.int64),
    }
    path = Path(path)
    data = save(tensors, metadata={"schema_version": str(SCHEMA_VERSION)})
    _write_atomically(path, data)
    return ShardRecord(f"{path.parent.name}/{path.name}", len(samples), hashlib.sha256(data).hexdigest())


def read_shard(path: str | os.PathLike[str], record: ShardRecord | None = None) -> Shard:
    """Read a shard; with `record`, check its hash and its number of samples against it.

    Raises DatasetError where the file is missing, broken, or another than the manifest lists.
    """
    path = Path(path)
    if not path.is_file():
        raise DatasetError(f"shard {path} does not exist")
    if record is not None and hashlib.sha256(path.read_bytes()).hexdigest() != record.sha256:
        raise DatasetError(f"shard {path} is not the file that the manifest lists: its sha256 differs")
    try:
        tensors = load_file(path)
    except (SafetensorError, ValueError) as error:
        raise DatasetError(f"shard {path} is not a readable safetensors file: {error}") from error
    for name, dtype in _DTYPES.items():
        if name not in tensors or tensors[name].dtype != dtype:
            found = tensors[name].dtype if name in tensors else "nothing"
            raise DatasetError(f"shard {path}: tensor {name!r} must be {np.dtype(dtype)}, found {found}")
    shard = Shard(**{name: tensors[name] for name in _DTYPES})
    n = len(shard)
    if len(shard.offsets) != n + 1 or shard.offsets[0] != 0 or shard.offsets[-1] != len(shard.points):
        raise DatasetError(f"shard {path}: offsets do not fit {n} samples of {len(shard.points)} points in all")
    if record is not None and n != record.n_samples:
        raise DatasetError(f"shard {path} holds {n} samples, the manifest says {record.n_samples}")
    return shard


def write_manifest(directory: str | os.PathLike[str], manifest: Manifest) -> Path:
    """Write DIR/manifest.json atomically and return its path."""
    path = Path(directory) / MANIFEST_NAME
    _write_atomically(path, (json.dumps(asdict(manifest), indent=1) + "\n").encode())
    return path


def read_manifest(directory: str | os.PathLike[str]) -> Manifest:
    """Read and check DIR/manifest.json.

    Raises DatasetError where it is missing, is not JSON, lacks a field or has another schema version.
    """
    path = Path(directory) / MANIFEST_NAME
    if not path.is_file():
        raise DatasetError(f"no data set in {directory}: {MANIFEST_NAME} does not exist")
    try:
        content = json.loads(path.read_text())
        version = content["schema_version"]
        if version != SCHEMA_VERSION:
            raise DatasetError(f"{path} has schema version {version}, this package reads {SCHEMA_VERSION}")
        content["shards"] = [ShardRecord(**record) for record in content["shards"]]
        return Manifest(**content)
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise DatasetError(f"{path} is not a manifest of this package: {error!r}") from error


def _write_atomically(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + ".tmp")
    with temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())  # a rename that outlives a power cut must not point to an empty file
    os.replace(temporary, path)
