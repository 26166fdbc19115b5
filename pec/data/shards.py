"""The data set on disk: a manifest and shards of labelled clouds.

    DIR/manifest.json               what was generated, from what, by which versions; which shards exist
    DIR/shards/00000.safetensors    tensors of one shard:
        points           (M, 3) float32   every cloud of the shard, one after the other; camera frame (OpenCV), metres
        offsets          (n + 1,) int64   cloud i is points[offsets[i]:offsets[i + 1]]
        class_index      (n,) int32       into the manifest's `classes`
        instance_index   (n,) int32       into the manifest's `instances`
        camera           (n,) int32       into the manifest's `cameras`
        T_camera_object  (n, 4, 4) float32
        seed             (n,) int64       the seed that drew the sample
        occlusion        (n,) float32     share of the object that others hide from the camera
        purity           (n,) float32     of the cloud's points on objects, the share on the labelled one

Tensors are little-endian and lie in the file one after the other, behind a JSON header that says where (the safetensors
format), so a reader may map the file into memory and touch only the clouds that it wants.

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
from safetensors.numpy import save

from pec.common.atomic_files import write_json, write_whole
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

SCHEMA_VERSION = 2
MANIFEST_NAME = "manifest.json"
_DTYPES = {
    "points": np.float32,
    "offsets": np.int64,
    "class_index": np.int32,
    "instance_index": np.int32,
    "camera": np.int32,
    "T_camera_object": np.float32,
    "seed": np.int64,
    "occlusion": np.float32,
    "purity": np.float32,
}
_CODES = {"F32": np.float32, "I64": np.int64, "I32": np.int32}


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
    camera: int = 0
    """Index into the manifest's `cameras`."""
    occlusion: float = 0.0
    """Share of the object, as the camera would see it alone, that others hide; 0 … 1."""
    purity: float = 1.0
    """Of the cloud's points on any object, the share that lies on the labelled one; 0 … 1."""


@dataclass(frozen=True)
class Shard:
    """The arrays of one shard, as the module's docstring lists them."""

    points: np.ndarray
    offsets: np.ndarray
    class_index: np.ndarray
    instance_index: np.ndarray
    camera: np.ndarray
    T_camera_object: np.ndarray
    seed: np.ndarray
    occlusion: np.ndarray
    purity: np.ndarray

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
    skipped: dict[str, str] = field(default_factory=dict)
    """Instances that should be in this shard and could not be captured, by name, and why."""


@dataclass(frozen=True)
class Manifest:
    """What a data set is and what of it exists already."""

    classes: list[str]
    instances: list[dict[str, Any]]
    """One mapping an instance, with at least `name` and `class`; a deformed copy says `copy_of` which name."""
    cameras: list[dict[str, Any]]
    """One mapping a camera, with at least `name`."""
    config: dict[str, Any]
    """The resolved configuration that generated it."""
    seed: int
    generator: dict[str, str]
    """Name and version of the generator and of the packages that decide its output."""
    shards: list[ShardRecord] = field(default_factory=list)
    complete: bool = False
    schema_version: int = SCHEMA_VERSION

    @property
    def originals(self) -> np.ndarray:
        """(number of instances,) int64: of each its own index, of a deformed copy that of what it is a copy of."""
        index = {(entry["class"], entry["name"]): number for number, entry in enumerate(self.instances)}
        return np.array(
            [index.get((entry["class"], entry.get("copy_of")), number) for number, entry in enumerate(self.instances)],
            np.int64,
        )


def shard_name(index: int, suffix: str = ".safetensors") -> str:
    """The path of shard `index`, relative to the data set's directory: `shards/00000.safetensors`."""
    return f"shards/{index:05d}{suffix}"


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
        "camera": np.array([sample.camera for sample in samples], np.int32),
        "T_camera_object": np.array([sample.T_camera_object for sample in samples], np.float32).reshape(-1, 4, 4),
        "seed": np.array([sample.seed for sample in samples], np.int64),
        "occlusion": np.array([sample.occlusion for sample in samples], np.float32),
        "purity": np.array([sample.purity for sample in samples], np.float32),
    }
    path = Path(path)
    data = save(tensors, metadata={"schema_version": str(SCHEMA_VERSION)})
    write_whole(path, data)
    return ShardRecord(f"{path.parent.name}/{path.name}", len(samples), hashlib.sha256(data).hexdigest())


def read_shard(path: str | os.PathLike[str], record: ShardRecord | None = None, *, mapped: bool = False) -> Shard:
    """Read a shard; with `record`, check its hash and its number of samples against it.

    mapped: the arrays are read-only views of the file, which stays open as long as one of them lives.
    Raises DatasetError where the file is missing, broken, or another than the manifest lists.
    """
    path = Path(path)
    if not path.is_file():
        raise DatasetError(f"shard {path} does not exist; {_WAY_OUT}")
    try:
        data = np.asarray(np.memmap(path, np.uint8, "r") if mapped else np.fromfile(path, np.uint8))
    except ValueError as error:  # an empty file cannot be mapped
        raise DatasetError(f"shard {path} is damaged: {error}; {_WAY_OUT}") from error
    if record is not None and hashlib.sha256(data.data).hexdigest() != record.sha256:
        raise DatasetError(
            f"shard {path} is not the file that the manifest lists: its sha256 differs, so it was damaged or changed; "
            f"{_WAY_OUT}"
        )
    try:
        tensors = _tensors(data)
    except (ValueError, KeyError, TypeError, UnicodeDecodeError) as error:
        raise DatasetError(f"shard {path} is not a readable safetensors file: {error}; {_WAY_OUT}") from error
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


_WAY_OUT = "the command that generated the data set makes missing and damaged shards anew"


def _tensors(data: np.ndarray) -> dict[str, np.ndarray]:
    """Views of the tensors in a safetensors file's bytes: length of the header, the header as JSON, the tensors."""
    if len(data) < 8:
        raise ValueError(f"it has only {len(data)} bytes")
    begin = 8 + int.from_bytes(data[:8].tobytes(), "little")
    header = json.loads(data[8:begin].tobytes())
    tensors = {}
    for name, entry in header.items():
        if name != "__metadata__":
            low, high = entry["data_offsets"]
            tensors[name] = data[begin + low : begin + high].view(_CODES[entry["dtype"]]).reshape(entry["shape"])
    return tensors


def write_manifest(directory: str | os.PathLike[str], manifest: Manifest, name: str = MANIFEST_NAME) -> Path:
    """Write DIR/manifest.json, or DIR/`name`, atomically and return its path."""
    path = Path(directory) / name
    write_json(path, asdict(manifest))
    return path


def read_manifest(directory: str | os.PathLike[str], name: str = MANIFEST_NAME) -> Manifest:
    """Read and check DIR/manifest.json, or DIR/`name`.

    Raises DatasetError where it is missing, is not JSON, lacks a field or has another schema version.
    """
    path = Path(directory) / name
    if not path.is_file():
        if not Path(directory).is_dir():
            raise DatasetError(f"no data set in {directory}: there is no such folder")
        hint = ""
        if list(Path(directory).glob(MANIFEST_NAME.replace(".json", ".*of*.json"))):
            hint = "; jobs have made parts of it, which the same command without shard= merges"
        raise DatasetError(f"no data set in {directory}: {name} does not exist{hint}")
    try:
        content = json.loads(path.read_text())
        version = content["schema_version"]
        if version != SCHEMA_VERSION:
            raise DatasetError(
                f"{path} has schema version {version}, this package reads {SCHEMA_VERSION}: generate the data set anew "
                f"into another folder, or read it with the version that made it ({_made_by(content)})"
            )
        content["shards"] = [ShardRecord(**record) for record in content["shards"]]
        return Manifest(**content)
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise DatasetError(f"{path} is not a manifest of this package: {error!r}") from error


def _made_by(content: dict[str, Any]) -> str:
    made_by = content.get("generator")
    return f"pecgrasp {made_by.get('pecgrasp', 'unknown')}" if isinstance(made_by, dict) else "unknown"
