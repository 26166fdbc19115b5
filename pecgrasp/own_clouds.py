"""One's own labelled clouds as `pec` reads them: a folder a class becomes one .npz of plain arrays."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import MISSING
from tqdm import tqdm

from grasping.cloud_files import SUFFIXES, read_object
from grasping.errors import CloudError
from grasping.validation import LARGEST_OBJECT
from pec.data.labelled_arrays import read_arrays, read_labelled, write_labelled
from pec.data.shards import MANIFEST_NAME
from pec.errors import ConfigError, DatasetError

__all__ = ["packed_clouds", "with_own_clouds"]

_PARTS = {"train", "training", "test", "testing", "val", "validation"}
_LAYOUT = f"expected FOLDER/<class>/*.{{{','.join(suffix[1:] for suffix in SUFFIXES)}}} or FOLDER/<class>/<instance>/*"


@dataclass(frozen=True)
class _File:
    path: Path
    label: int
    instance: str


def with_own_clouds(settings: dict[str, Any], say: Callable[[str], None] = print) -> dict[str, Any]:
    """A run's settings with a `dataset.path` that `pec` reads, and without `dataset.scale`.

    A folder of classes is packed as a .npz in `cache`, under a name that differs where its files do; a .npz is taken as
    it is, or packed in metres where `dataset.scale` is not 1. What was found and left out is said. Raises
    DatasetError that names the file, ConfigError for a scale that makes no sense.
    """
    dataset = dict(settings["dataset"])
    scale = dataset.pop("scale", 1.0)
    if dataset["path"] == MISSING:
        raise ConfigError("dataset.path=… must be given: the folder or the .npz of the clouds")
    if "*" in dataset["path"]:
        raise ConfigError(f"dataset.path={dataset['path']}: the folder of the classes' folders, without a pattern")
    if isinstance(scale, bool) or not (isinstance(scale, (int, float)) and 0 < scale < float("inf")):
        raise ConfigError(f"dataset.scale = {scale!r} must be a positive number, such as 0.001 for millimetres")
    path = Path(dataset["path"])
    cache = Path(settings.get("cache") or settings["output"])
    packed = packed_clouds(path, scale, cache, progress=bool(settings.get("progress")))
    if packed is not None:
        _say_what_is_there(path, packed, settings, say)
        dataset["path"] = str(packed)
    elif scale != 1:
        raise ConfigError(f"dataset.scale={scale} is for one's own clouds, and {path} holds others or none")
    return {**settings, "dataset": dataset}


def packed_clouds(path: Path, scale: float, cache: Path, *, progress: bool = False) -> Path | None:
    """The .npz of one's own clouds in metres, which may be `path` itself; None where it holds something else."""
    if path.suffix == ".npz" and path.is_file() and "train_points" not in read_arrays(path):
        return path if scale == 1 else _packed(path, scale, cache, progress)
    if path.is_dir() and not list(path.glob(MANIFEST_NAME.replace(".json", "*.json"))):
        return _packed(path, scale, cache, progress)
    return None


def _packed(path: Path, scale: float, cache: Path, progress: bool) -> Path:
    """The archive of these clouds in metres; it is written where there is none yet of the same files."""
    if path.is_file():
        key = hashlib.sha256(repr(scale).encode() + path.read_bytes())
    else:
        files, classes, left_out = _listed(path)
        key = hashlib.sha256(repr((scale, [os.fspath(file.path.relative_to(path)) for file in files])).encode())
        for file in files:
            key.update(hashlib.sha256(file.path.read_bytes()).digest())
    packed = cache / f"clouds_{key.hexdigest()[:16]}.npz"
    if packed.is_file():
        return packed
    if path.is_file():
        stored = read_labelled(path)
        clouds = stored.dataset
        scaled = [cloud * np.float32(scale) for cloud in clouds.clouds]
        instances = [str(instance) for instance in clouds.instances]
        write_labelled(packed, scaled, clouds.labels.tolist(), instances, clouds.classes, stored.remarks)
        return packed
    read, lost = [], Counter[Path]()
    for file in tqdm(files, desc="reading", unit="file", disable=not progress, leave=False):
        try:
            points, others = read_object(file.path)
        except (CloudError, OSError) as error:
            raise DatasetError(str(error)) from error
        if not len(points):
            raise DatasetError(f"{file.path} holds no valid point")
        read.append(points * np.float32(scale))
        if others:
            lost[file.path] = others
    remarks = [left_out] if left_out else []
    if lost:
        where = f"files: {len(lost)}, first {next(iter(lost))}"
        remarks.append(f"left out: {lost.total()} points that are not finite or are 0, 0, 0; {where}")
    write_labelled(packed, read, [file.label for file in files], [file.instance for file in files], classes, remarks)
    return packed


def _listed(folder: Path) -> tuple[list[_File], list[str], str]:
    """The clouds of a folder, the names of its classes, and what else lies there."""
    classes = sorted(each.name for each in folder.iterdir() if each.is_dir() and not each.name.startswith((".", "__")))
    if classes and {name.lower() for name in classes} <= _PARTS:
        raise DatasetError(
            f"{folder}: {', '.join(classes)} are no classes; put all into FOLDER/<class>: a run splits them itself"
        )
    files: list[_File] = []
    others = Counter[str](f"{each.suffix} beside the classes" for each in folder.glob("*.*") if _is_cloud(each))
    for label, name in enumerate(classes):
        there = sorted(each for each in (folder / name).rglob("*") if each.is_file() and not each.name.startswith("."))
        clouds = [each for each in there if _is_cloud(each)] or [
            each for each in there if each.suffix.lower() == ".txt"
        ]
        if not clouds:
            kinds = ", ".join(sorted({each.suffix or each.name for each in there}))[:120]
            raise DatasetError(f"{folder / name} holds no cloud, only {kinds or 'nothing'}: {_LAYOUT}")
        others.update(each.suffix or each.name for each in there if each not in set(clouds))
        # A file in the class's own folder is an instance, and so is a folder with all that is in it.
        files += [_File(each, label, each.relative_to(folder / name).parts[0]) for each in clouds]
    if not files:
        raise DatasetError(f"{folder} is no data set: {_LAYOUT}; or a folder that pecgrasp generate has written")
    left_out = ", ".join(f"{count} {kind}" for kind, count in sorted(others.items()))
    return files, classes, left_out and f"left out: files, {left_out}"


def _is_cloud(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and path.is_file()


def _say_what_is_there(path: Path, archive: Path, settings: dict[str, Any], say: Callable[[str], None]) -> None:
    labelled = read_labelled(archive)
    clouds = labelled.dataset
    counts = np.array([len(cloud) for cloud in clouds.clouds])
    listed = ", ".join(f"{name} {np.count_nonzero(clouds.labels == k)}" for k, name in enumerate(clouds.classes))
    n_instances = len(np.unique(clouds.instances))
    say(f"{path}: {len(clouds)} clouds of {n_instances} instances ({listed}), {_range(counts)} points")
    if archive != path:
        say(f"packed in {archive}")
    for remark in labelled.remarks:
        say(remark)
    least = settings.get("preprocess", {}).get("n_points", 1)
    if few := int(np.count_nonzero(counts < least)):
        say(f"left out: {few} clouds of fewer than {least} points")
    spans = [float(np.ptp(cloud, axis=0).max()) for cloud in clouds.clouds if len(cloud)]
    if spans and (span := float(np.median(spans))) > LARGEST_OBJECT:
        say(f"half of the clouds span {span:.4g} m or more: if these are millimetres, say dataset.scale=0.001")


def _range(counts: np.ndarray) -> str:
    return f"{counts.min()}" if counts.min() == counts.max() else f"{counts.min()} to {counts.max()}"
