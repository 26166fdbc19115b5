"""Labelled clouds from files: a generated data set's directory, ModelNet10 as one archive, or one's own arrays."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pec.common.run_identity import files_key
from pec.data.dataset import CloudDataset
from pec.data.labelled_arrays import FORM, read_arrays, read_labelled
from pec.data.shards import MANIFEST_NAME, read_manifest, read_shard
from pec.data.splits import SPLITS_NAME, read_splits
from pec.errors import DatasetError

__all__ = ["SIZES", "data_version", "load_dataset"]

SIZES = ("stored", "mesh")
# A mapped file stays open, and a process may hold 1024 files: shards beyond these are read into memory.
_MOST_MAPPED = 400


def data_version(path: str | os.PathLike[str]) -> str:
    """Hash of an archive, or of the files that list a generated data set and its splits; "missing" where it is not."""
    path = Path(path)
    # Not its results.json: that tells of the last command, and generating a whole set once more changes nothing else.
    listing = [path / name for name in (MANIFEST_NAME, SPLITS_NAME)]
    files = [path] if path.is_file() else [file for file in listing if file.is_file()]
    return files_key(files) if files else "missing"


def load_dataset(
    path: str | os.PathLike[str],
    classes: Sequence[str] | None = None,
    samples_per_instance: int | None = None,
    min_points: int = 1,
    size: str = "stored",
) -> CloudDataset:
    """A generated data set's directory, ModelNet10 as one .npz, or a .npz as of `pec.data.labelled_arrays`.

    size: "stored", or "mesh" as `CloudDataset.in_mesh_size`.

    Of a directory every file is checked against its hash, and mapped: points are read from it when they are used.
    `classes` keeps only those, in that order; `samples_per_instance` keeps the first ones of each instance; clouds of
    fewer than `min_points` points are dropped. Raises DatasetError where there is none, it is broken or unfinished, a
    class is unknown, or a class is left without samples. A class named "unknown" holds strangers
    and comes last, whatever the order.
    """
    path = Path(path)
    dataset = _load_archive(path) if path.suffix == ".npz" else _load_generated(path)
    keep = np.array([len(cloud) >= min_points for cloud in dataset.clouds], bool)
    if samples_per_instance is not None:
        keep &= _rank_within(dataset.instances) < samples_per_instance
    if classes is not None:
        unknown = [name for name in classes if name not in dataset.classes]
        if unknown:
            raise DatasetError(f"{path} has no class {unknown[0]!r}; it has {', '.join(dataset.classes)}")
        keep &= np.isin(dataset.labels, [dataset.classes.index(name) for name in classes])
    dataset = replace(dataset, stored=np.arange(len(dataset))).subset(np.flatnonzero(keep))
    if classes is not None:
        new_label = np.array([classes.index(name) if name in classes else -1 for name in dataset.classes])
        dataset = replace(dataset, classes=list(classes), labels=new_label[dataset.labels])
    for label, name in enumerate(dataset.classes):
        if not (dataset.labels == label).any():
            raise DatasetError(f"{path}: no sample of class {name!r} with at least {min_points} points")
    dataset = dataset.with_strangers_last()
    return dataset.in_mesh_size() if size == "mesh" else dataset


def _load_generated(directory: Path) -> CloudDataset:
    if directory.is_file():
        raise DatasetError(f"{directory} is no data set: a folder, or a .npz; {FORM}")
    manifest = read_manifest(directory)
    if not manifest.complete:
        raise DatasetError(f"{directory} is unfinished: run the same generation command again, it resumes")
    if not manifest.shards:
        raise DatasetError(f"{directory} holds no shards")
    shards = [
        read_shard(directory / record.file, record, mapped=number < _MOST_MAPPED)
        for number, record in enumerate(manifest.shards)
    ]
    instances = np.concatenate([shard.instance_index for shard in shards]).astype(np.int64)
    return CloudDataset(
        manifest.classes,
        [shard.cloud(index) for shard in shards for index in range(len(shard))],
        np.concatenate([shard.class_index for shard in shards]).astype(np.int64),
        instances,
        " ".join(record.sha256 for record in manifest.shards),
        read_splits(directory, len(instances)),
        # A cloud that a camera took has turned and moved only.
        np.concatenate([np.cbrt(np.linalg.det(shard.T_camera_object[:, :3, :3])) for shard in shards]),
        originals=manifest.originals[instances],
    )


def _load_archive(path: Path) -> CloudDataset:
    arrays = read_arrays(path)
    return _modelnet(path, arrays) if "train_points" in arrays else read_labelled(path, arrays).dataset


def _modelnet(path: Path, arrays: dict[str, np.ndarray]) -> CloudDataset:
    """ModelNet10 clouds scaled to the unit sphere: arrays `train_points`, `train_labels`, `test_…`, `class_names`, and
    with `train_scale`, `test_scale`, the radii of the meshes, their size, too."""
    try:
        parts = [(arrays[f"{part}_points"], arrays[f"{part}_labels"]) for part in ("train", "test")]
        names = [str(name) for name in arrays["class_names"]]
        sized = "train_scale" in arrays
        radii = np.concatenate([arrays["train_scale"], arrays["test_scale"]]) if sized else None
    except KeyError as error:
        raise DatasetError(f"{path} is not a ModelNet archive of this form: {error}") from error
    clouds = np.concatenate([points for points, _ in parts]).astype(np.float32)
    n = len(clouds)
    return CloudDataset(
        names,
        list(clouds),
        np.concatenate([labels for _, labels in parts]).astype(np.int64),
        np.arange(n, dtype=np.int64),
        hashlib.sha256(path.read_bytes()).hexdigest(),
        {"official": np.arange(n) >= len(parts[0][1])},
        None if radii is None else 1 / radii.astype(float),
    )


def _rank_within(groups: np.ndarray) -> np.ndarray:
    """For each element its place among the elements of its group."""
    order = np.argsort(groups, kind="stable")
    _, first, counts = np.unique(groups[order], return_index=True, return_counts=True)
    rank = np.empty(len(groups), np.int64)
    rank[order] = np.arange(len(groups)) - np.repeat(first, counts)
    return rank
