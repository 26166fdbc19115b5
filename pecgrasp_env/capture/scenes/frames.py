"""The frames on disk: shards of depth frames with what each pixel shows, beside the manifest of every data set here.

DIR/manifest.json      as of `pec.data.shards`: what was generated, from what; `config.kinds`, `cameras`, `classes`
DIR/shards/00000.npz   frames of some scenes, compressed, no pickle; n frames of k objects in all:
    depth_0 …            (H, W) uint16, tenths of a millimetre along the optical axis, 0: a hole (or beyond 6.5 m)
    instance_0 …         (H, W) uint8: 0 the room, 1 the table (or the floor that they lie on), 2 … the objects,
                         254 the bin that they lie in; also where depth has a hole
    K                    (n, 3, 3) float64, px; pixel (row r, column c) looks through (c + 0.5, r + 0.5)
    T_world_camera       (n, 4, 4) float64, OpenCV's camera axes; the table is z = 0 of the world
    kind, camera         (n,) int32, into `config.kinds` and `cameras` of the manifest
    scene, seed          (n,) int64: number of the scene, and the seed that drew it
    val                  (n,) bool: of a scene kept apart from training
    objects              (n + 1,) int64: frame i has the rows objects[i]:objects[i + 1] of the following ones
    class_index          (k,) int32, into `classes`; row j of frame i is labelled 2 + j
    pose                 (k, 7) float64, world frame, m and quaternion wxyz
    visible              (k,) float32: share of what the camera would see of it alone that others leave to be seen
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grasping.errors import DAMAGED_NPZ
from pec.common.atomic_files import write_whole
from pec.data.shards import ShardRecord, read_manifest
from pec.errors import DatasetError

__all__ = [
    "BIN_LABEL",
    "FIRST_OBJECT",
    "TABLE_LABEL",
    "LabelledFrame",
    "cloud_of",
    "frames_of",
    "read_frames",
    "write_frames",
]

TABLE_LABEL, FIRST_OBJECT, BIN_LABEL = 1, 2, 254
_UNITS = 1e4  # of depth in a metre
_DEEPEST = 65535 / _UNITS


@dataclass(frozen=True)
class LabelledFrame:
    """One frame; arrays and units as the module's docstring has them, but depth in metres, (H, W) float32."""

    depth: np.ndarray
    instance: np.ndarray
    K: np.ndarray
    T_world_camera: np.ndarray
    kind: int
    camera: int
    scene: int
    seed: int
    val: bool
    class_index: np.ndarray
    pose: np.ndarray
    visible: np.ndarray


def cloud_of(frame: LabelledFrame) -> np.ndarray:
    """(H, W, 3) float32 m in the camera's frame, NaN where nothing was measured."""
    h, w = frame.depth.shape
    K = frame.K
    z = np.where(frame.depth > 0, frame.depth, np.float32(np.nan))
    x = (np.arange(w) + 0.5 - K[0, 2]) / K[0, 0]
    y = (np.arange(h) + 0.5 - K[1, 2]) / K[1, 1]
    return np.stack([z * x, z * y[:, None], z], axis=-1).astype(np.float32)


_EACH = {"K": np.float64, "T_world_camera": np.float64, "kind": np.int32, "camera": np.int32, "scene": np.int64,
         "seed": np.int64, "val": np.bool_}  # fmt: skip
_ROWS = {"class_index": np.int32, "pose": np.float64, "visible": np.float32}


def write_frames(path: str | os.PathLike[str], frames: Sequence[LabelledFrame]) -> ShardRecord:
    """Write frames as one shard, atomically, and return its record for the manifest. `path` is DIR/shards/NAME."""
    path = Path(path)
    arrays: dict[str, np.ndarray] = {}
    for i, frame in enumerate(frames):
        tenths = np.rint(np.where(frame.depth <= _DEEPEST, frame.depth, 0) * _UNITS)
        arrays[f"depth_{i}"] = tenths.astype(np.uint16)
        arrays[f"instance_{i}"] = np.asarray(frame.instance, np.uint8)
    for name, dtype in _EACH.items():
        arrays[name] = np.array([getattr(frame, name) for frame in frames], dtype)
    arrays["objects"] = np.concatenate([[0], np.cumsum([len(frame.class_index) for frame in frames])]).astype(np.int64)
    for name, dtype in _ROWS.items():
        rows = [np.asarray(getattr(frame, name), dtype) for frame in frames]
        arrays[name] = np.concatenate(rows) if rows else np.zeros(0, dtype)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]  # its members have no dates: the same frames are the same bytes
    data = buffer.getvalue()
    write_whole(path, data)
    return ShardRecord(f"{path.parent.name}/{path.name}", len(frames), hashlib.sha256(data).hexdigest())


def read_frames(path: str | os.PathLike[str]) -> Iterator[LabelledFrame]:
    """The frames of a shard, one after the other. Raises DatasetError where it is missing or damaged."""
    try:
        with np.load(path, allow_pickle=False) as shard:
            each = {name: shard[name] for name in (*_EACH, "objects")}
            rows = {name: shard[name] for name in _ROWS}
            for i in range(len(each["kind"])):
                here = slice(*each["objects"][i : i + 2])
                depth = shard[f"depth_{i}"].astype(np.float32) / np.float32(_UNITS)
                yield LabelledFrame(
                    depth=depth,
                    instance=shard[f"instance_{i}"],
                    K=each["K"][i],
                    T_world_camera=each["T_world_camera"][i],
                    kind=int(each["kind"][i]),
                    camera=int(each["camera"][i]),
                    scene=int(each["scene"][i]),
                    seed=int(each["seed"][i]),
                    val=bool(each["val"][i]),
                    class_index=rows["class_index"][here],
                    pose=rows["pose"][here],
                    visible=rows["visible"][here],
                )
    except DAMAGED_NPZ as error:
        raise DatasetError(
            f"{path} is no shard of labelled frames: {error}; the command that generated the data set makes missing "
            "and damaged shards anew"
        ) from error


def frames_of(directory: str | os.PathLike[str], val: bool | None = None) -> Iterator[LabelledFrame]:
    """The frames of all shards that a data set's manifest lists so far, of `val` true or false only where it is given.

    Raises DatasetError where there is no data set or a shard is damaged.
    """
    directory = Path(directory)
    for record in read_manifest(directory).shards:
        for frame in read_frames(directory / record.file):
            if val is None or frame.val == val:
                yield frame
