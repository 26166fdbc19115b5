"""Labelled clouds in memory: loading, splitting, and the dissertation's defects."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pec.errors import DatasetError
from pec.shards import read_manifest, read_shard

__all__ = [
    "CloudDataset",
    "load_dataset",
    "remove_around_random_point",
    "split_by_instance",
    "split_by_sample",
]


@dataclass(frozen=True)
class CloudDataset:
    """Clouds of several classes, one after the other in `points`.

    A class has instances (one mesh or one draw of a procedural shape), an instance has samples (one cloud each).
    """

    classes: list[str]
    points: np.ndarray
    """(M, 3) float32, metres."""
    offsets: np.ndarray
    """(n + 1,) int64: cloud i is points[offsets[i]:offsets[i + 1]]."""
    labels: np.ndarray
    """(n,) int64, index into `classes`."""
    instances: np.ndarray
    """(n,) int64, equal for samples of one instance, different between classes."""
    fingerprint: str
    """Differs where the data differ: the hashes of what was read."""
    official_test: np.ndarray | None = None
    """(n,) bool where the data come with a split of their own."""

    def __len__(self) -> int:
        return len(self.labels)

    def cloud(self, index: int) -> np.ndarray:
        """The (N, 3) float32 points of sample `index`."""
        return self.points[self.offsets[index] : self.offsets[index + 1]]

    def subset(self, indices: np.ndarray) -> CloudDataset:
        """The samples `indices`, with all classes."""
        lengths = np.diff(self.offsets)[indices]
        clouds = [self.cloud(i) for i in indices]
        return CloudDataset(
            self.classes,
            np.concatenate(clouds) if clouds else self.points[:0],
            np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
            self.labels[indices],
            self.instances[indices],
            self.fingerprint,
            None if self.official_test is None else self.official_test[indices],
        )


def load_dataset(
    path: str | os.PathLike[str],
    classes: Sequence[str] | None = None,
    samples_per_instance: int | None = None,
    min_points: int = 1,
) -> CloudDataset:
    """A generated data set's directory, or ModelNet10 as one .npz, whole, in memory.

    `classes` keeps only those, in that order; `samples_per_instance` keeps the first ones of each instance; clouds of
    fewer than `min_points` points are dropped. Raises DatasetError where there is none, it is broken or unfinished, a
    class is unknown, or a class is left without samples.
    """
    path = Path(path)
    dataset = _load_modelnet(path) if path.suffix == ".npz" else _load_generated(path)
    keep = np.diff(dataset.offsets) >= min_points
    if samples_per_instance is not None:
        keep &= _rank_within(dataset.instances) < samples_per_instance
    if classes is not None:
        unknown = [name for name in classes if name not in dataset.classes]
        if unknown:
            raise DatasetError(f"{path} has no class {unknown[0]!r}; it has {', '.join(dataset.classes)}")
        keep &= np.isin(dataset.labels, [dataset.classes.index(name) for name in classes])
    dataset = dataset.subset(np.flatnonzero(keep))
    if classes is not None:
        new_label = np.array([classes.index(name) if name in classes else -1 for name in dataset.classes])
        dataset = CloudDataset(
            list(classes),
            dataset.points,
            dataset.offsets,
            new_label[dataset.labels],
            dataset.instances,
            dataset.fingerprint,
            dataset.official_test,
        )
    for label, name in enumerate(dataset.classes):
        if not (dataset.labels == label).any():
            raise DatasetError(f"{path}: no sample of class {name!r} with at least {min_points} points")
    return dataset


def _load_generated(directory: Path) -> CloudDataset:
    manifest = read_manifest(directory)
    if not manifest.complete:
        raise DatasetError(f"{directory} is unfinished: run the same generation command again, it resumes")
    shards = [read_shard(directory / record.file, record) for record in manifest.shards]
    if not shards:
        raise DatasetError(f"{directory} holds no shards")
    lengths = np.concatenate([np.diff(shard.offsets) for shard in shards])
    return CloudDataset(
        manifest.classes,
        np.concatenate([shard.points for shard in shards]),
        np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        np.concatenate([shard.class_index for shard in shards]).astype(np.int64),
        np.concatenate([shard.instance_index for shard in shards]).astype(np.int64),
        " ".join(record.sha256 for record in manifest.shards),
    )


def _load_modelnet(path: Path) -> CloudDataset:
    """ModelNet10 clouds scaled to the unit sphere: arrays `train_points`, `train_labels`, `test_…`, `class_names`."""
    if not path.is_file():
        raise DatasetError(f"{path} does not exist")
    with np.load(path, allow_pickle=False) as arrays:
        try:
            parts = [(arrays[f"{part}_points"], arrays[f"{part}_labels"]) for part in ("train", "test")]
            names = [str(name) for name in arrays["class_names"]]
        except KeyError as error:
            raise DatasetError(f"{path} is not a ModelNet archive of this form: {error}") from error
    clouds = np.concatenate([points for points, _ in parts]).astype(np.float32)
    n, n_points, _ = clouds.shape
    return CloudDataset(
        names,
        clouds.reshape(-1, 3),
        np.arange(n + 1, dtype=np.int64) * n_points,
        np.concatenate([labels for _, labels in parts]).astype(np.int64),
        np.arange(n, dtype=np.int64),
        hashlib.sha256(path.read_bytes()).hexdigest(),
        np.arange(n) >= len(parts[0][1]),
    )


def _rank_within(groups: np.ndarray) -> np.ndarray:
    """For each element its place among the elements of its group."""
    order = np.argsort(groups, kind="stable")
    _, first, counts = np.unique(groups[order], return_index=True, return_counts=True)
    rank = np.empty(len(groups), np.int64)
    rank[order] = np.arange(len(groups)) - np.repeat(first, counts)
    return rank


def split_by_sample(
    dataset: CloudDataset, first_fraction: float, rng: np.random.Generator, among: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Two sorted index arrays; `first_fraction` of each instance's samples (of each class's where it has one each).

    `among` restricts both to these indices. Every instance may be on both sides: objects are seen, views are not.
    """
    among = np.arange(len(dataset)) if among is None else among
    strata = dataset.instances[among]
    if len(np.unique(strata)) == len(strata):
        strata = dataset.labels[among]
    return _split(among, [among[strata == stratum] for stratum in np.unique(strata)], first_fraction, rng)


def split_by_instance(
    dataset: CloudDataset, first_fraction: float, rng: np.random.Generator, among: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Two sorted index arrays of which no instance is on both sides; at least one instance of each class on each.

    Raises DatasetError where a class has a single instance.
    """
    among = np.arange(len(dataset)) if among is None else among
    first: list[np.ndarray] = []
    for label, name in enumerate(dataset.classes):
        instances = np.unique(dataset.instances[among][dataset.labels[among] == label])
        if len(instances) < 2:
            raise DatasetError(f"cannot split by instance: class {name!r} has {len(instances)} instance(s)")
        n_first = min(max(round(first_fraction * len(instances)), 1), len(instances) - 1)
        first.append(rng.permutation(instances)[:n_first])
    in_first = np.isin(dataset.instances[among], np.concatenate(first))
    return among[in_first], among[~in_first]


def _split(
    among: np.ndarray, strata: list[np.ndarray], first_fraction: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    first = np.concatenate([rng.permutation(part)[: round(first_fraction * len(part))] for part in strata])
    return np.sort(first), np.setdiff1d(among, first)


def remove_around_random_point(points: np.ndarray, max_fraction: float, rng: np.random.Generator) -> np.ndarray:
    """The published defect: `points` (N, 3) without the m nearest of a random point of theirs, m uniform in
    [0, max_fraction · N]; the others keep their order."""
    m = int(rng.uniform(0, max_fraction) * len(points))
    if m == 0:
        return points
    distance = np.square(points - points[rng.integers(len(points))]).sum(axis=1)
    keep = np.ones(len(points), bool)
    keep[np.argpartition(distance, m - 1)[:m]] = False
    return points[keep]
