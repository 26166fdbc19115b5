"""Grasp labels on disk: objects that lie on a table, what a camera saw of each, and what became of grasps on it.

    DIR/manifest.json      as of `pec.data.shards`; `config.samplers` and `config.outcomes` name the codes below
    DIR/shards/00000.npz   S scenes with G grasps and N points in all, compressed, no pickle:
        classes, instances   (S,) names of the object that lies there
        points               (N, 3) float32, what was measured of it; world frame, m, the table is z = 0
        cloud_starts         (S + 1,) int64: scene s has points[cloud_starts[s]:cloud_starts[s + 1]]
        T_world_camera       (S, 4, 4) float64, OpenCV's axes
        T_world_object       (S, 4, 4) float64, as it lay before anything touched it
        scene_of             (G,) int32, the scene of each grasp, in rising order
        T_world_grasp        (G, 4, 4) float32: origin midway between the pads' centres, +z approach, +x closing
        widths               (G,) float32 m, the opening at contact that was asked for
        openings             (G,) float32 m, the opening to come in with
        sampler              (G,) uint8, into `config.samplers`: what drew the grasp
        outcome              (G,) uint8, into `config.outcomes`: what happened; 0 is "held", all others are failures

A record of the manifest counts grasps as its samples. NumPy alone reads a shard.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from pec.common.atomic_files import write_whole
from pec.common.damaged_npz import DAMAGED_NPZ
from pec.data.shards import Manifest, ShardRecord, read_manifest
from pec.errors import DatasetError

__all__ = ["HELD", "GraspLabels", "GraspScene", "read_grasp_shard", "write_grasp_shard"]

HELD = 0
"""The outcome of a grasp that lifted the object and kept it through the shake."""

_OF_SCENE: dict[str, type[np.generic]] = {"T_world_camera": np.float64, "T_world_object": np.float64}
_OF_GRASP: dict[str, type[np.generic]] = {
    "T_world_grasp": np.float32,
    "widths": np.float32,
    "openings": np.float32,
    "sampler": np.uint8,
    "outcome": np.uint8,
}


@dataclass(frozen=True)
class GraspScene:
    """One object as it lay and was seen, and the grasps that were tried on it: arrays as the module's docstring has
    them, without the first axis of what belongs to a scene."""

    class_name: str
    instance: str
    points: np.ndarray
    T_world_camera: np.ndarray
    T_world_object: np.ndarray
    T_world_grasp: np.ndarray
    widths: np.ndarray
    openings: np.ndarray
    sampler: np.ndarray
    outcome: np.ndarray

    @property
    def thing(self) -> str:
        """Class and instance, "mug/mug_3": two classes may have instances of one name."""
        return f"{self.class_name}/{self.instance}"

    @property
    def held(self) -> np.ndarray:
        """(G,) bool, the label to learn."""
        return self.outcome == HELD


class GraspLabels:
    """A folder of grasp labels, read scene by scene.

    manifest: that of a share of the set; None: what lies in the folder. classes, instances, samplers, outcomes: names;
    `instances` are "class/instance", as `GraspScene.thing`.
    Raises DatasetError where the folder holds no grasp labels.
    """

    def __init__(self, directory: str | os.PathLike[str], manifest: Manifest | None = None) -> None:
        self.directory = Path(directory)
        self.manifest = read_manifest(directory) if manifest is None else manifest
        config = self.manifest.config
        for name in ("samplers", "outcomes"):
            if not isinstance(config.get(name), list):
                raise DatasetError(f"{directory} holds no grasp labels: its manifest's config has no list of {name}")
        self.samplers, self.outcomes = tuple(config["samplers"]), tuple(config["outcomes"])
        if self.outcomes[HELD] != "held":
            raise DatasetError(f"{directory}: config.outcomes must begin with 'held', got {list(self.outcomes)}")
        self.classes = tuple(self.manifest.classes)
        self.instances = tuple(f"{entry['class']}/{entry['name']}" for entry in self.manifest.instances)

    def __len__(self) -> int:
        """Grasps of all shards that are there."""
        return sum(record.n_samples for record in self.manifest.shards)

    def scenes(self, instances: Collection[str] | None = None) -> Iterator[GraspScene]:
        """The scenes of all shards, in order; only those of `instances` where given.

        Raises DatasetError where a shard is missing or damaged.
        """
        for record in self.manifest.shards:
            for scene in read_grasp_shard(self.directory / record.file, record):
                if instances is None or scene.thing in instances:
                    yield scene

    def split(self, train_fraction: float = 0.75, seed: int = 0) -> tuple[frozenset[str], frozenset[str]]:
        """The instances to train on and those to test on, of each class so many as the fraction says.

        A deformed copy goes where its original goes; a class of a single instance is trained on. Shards that are still
        to come change nothing. Raises DatasetError where nothing is left to test on.
        """
        if not 0 < train_fraction < 1:
            raise DatasetError(f"train_fraction must lie between 0 and 1, got {train_fraction}")
        class_of = np.array([self.classes.index(entry["class"]) for entry in self.manifest.instances])
        originals, rng = self.manifest.originals, np.random.default_rng(seed)
        first: list[np.ndarray] = []
        for label in range(len(self.classes)):
            things = np.unique(originals[class_of == label])
            n_first = min(max(round(train_fraction * len(things)), 1), max(len(things) - 1, 1))
            first.append(rng.permutation(things)[:n_first])
        trained = np.isin(originals, np.concatenate(first))
        if trained.all():
            raise DatasetError(f"{self.directory}: no class has two instances, so none is left to test on")
        train, test = (frozenset(np.array(self.instances)[part].tolist()) for part in (trained, ~trained))
        return train, test

    @cached_property
    def counts(self) -> np.ndarray:
        """(classes, samplers, outcomes) int64: how many grasps; reads all shards."""
        table = np.zeros((len(self.classes), len(self.samplers), len(self.outcomes)), np.int64)
        for scene in self.scenes():
            np.add.at(table[self.classes.index(scene.class_name)], (scene.sampler, scene.outcome), 1)
        return table


def write_grasp_shard(path: str | os.PathLike[str], scenes: Sequence[GraspScene]) -> ShardRecord:
    """Write scenes as one shard, atomically, and return its record for the manifest. `path` is DIR/shards/NAME."""
    path = Path(path)
    n_points = [len(scene.points) for scene in scenes]
    n_grasps = [len(scene.widths) for scene in scenes]
    arrays: dict[str, np.ndarray] = {
        "classes": np.array([scene.class_name for scene in scenes], np.str_),
        "instances": np.array([scene.instance for scene in scenes], np.str_),
        "points": np.concatenate([np.zeros((0, 3)), *(scene.points for scene in scenes)]).astype(np.float32),
        "cloud_starts": np.concatenate([[0], np.cumsum(n_points)]).astype(np.int64),
        "scene_of": np.repeat(np.arange(len(scenes)), n_grasps).astype(np.int32),
    }
    for name, dtype in _OF_SCENE.items():
        arrays[name] = np.array([getattr(scene, name) for scene in scenes], dtype).reshape(-1, 4, 4)
    for name, dtype in _OF_GRASP.items():
        shape = (0, 4, 4) if name == "T_world_grasp" else (0,)
        rows = [np.asarray(getattr(scene, name), dtype) for scene in scenes]
        arrays[name] = np.concatenate([np.zeros(shape, dtype), *rows])
    if bad := [name for name, array in arrays.items() if array.dtype.kind == "f" and not np.isfinite(array).all()]:
        raise DatasetError(f"grasp labels for {path}: {', '.join(bad)} must be finite")
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]  # its members have no dates: the same scenes are the same bytes
    data = buffer.getvalue()
    write_whole(path, data)
    return ShardRecord(f"{path.parent.name}/{path.name}", sum(n_grasps), hashlib.sha256(data).hexdigest())


def read_grasp_shard(path: str | os.PathLike[str], record: ShardRecord | None = None) -> list[GraspScene]:
    """The scenes of a shard. Raises DatasetError where it is missing, damaged, or another than the record's."""
    try:
        data = Path(path).read_bytes()
        if record is not None and hashlib.sha256(data).hexdigest() != record.sha256:
            raise ValueError("its sha256 is not the manifest's")
        with np.load(io.BytesIO(data), allow_pickle=False) as shard:
            arrays = {name: shard[name] for name in shard.files}
        n_scenes, clouds = len(arrays["classes"]), arrays["cloud_starts"]
        grasps = np.searchsorted(arrays["scene_of"], np.arange(n_scenes + 1))
        return [
            GraspScene(
                str(arrays["classes"][s]),
                str(arrays["instances"][s]),
                arrays["points"][clouds[s] : clouds[s + 1]],
                **{name: arrays[name][s] for name in _OF_SCENE},
                **{name: arrays[name][grasps[s] : grasps[s + 1]] for name in _OF_GRASP},
            )
            for s in range(n_scenes)
        ]
    except DAMAGED_NPZ as error:
        raise DatasetError(
            f"{path} is no shard of grasp labels: {error}; the command that generated them makes missing and damaged "
            "shards anew"
        ) from error
