"""Splits of a data set into two parts that never overlap: by sample, as published, or by instance.

A generated data set carries one of each in splits.json, so that every training run and every tool means the same test
samples: {"schema_version", "seed", "train_fraction", "test": {"sample": […], "instance": […]}}, indices of the samples
in the order of the manifest's shards. Only test is listed; all the others are train. A split that the data do not allow
(by instance, where a class has a single one) is left out.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from pec.common.atomic_files import write_json
from pec.errors import DatasetError

__all__ = [
    "SPLITS_NAME",
    "TRAIN_FRACTION",
    "Labelled",
    "divide",
    "read_splits",
    "split_by_instance",
    "split_by_sample",
    "write_splits",
]

SPLITS_NAME = "splits.json"
TRAIN_FRACTION = 0.75
"""Of the dissertation."""
_SCHEMA_VERSION = 1


class Labelled(Protocol):
    """What a split looks at: class names, and of each sample its label, its instance and its thing, (n,) int64 each:
    an instance and its deformed copies are one thing."""

    @property
    def classes(self) -> Sequence[str]: ...
    @property
    def labels(self) -> np.ndarray: ...
    @property
    def instances(self) -> np.ndarray: ...
    @property
    def things(self) -> np.ndarray: ...


class WithSplits(Labelled, Protocol):
    """`test`: of each split that came with the data a mask (n,) bool, true for test."""

    @property
    def test(self) -> Mapping[str, np.ndarray]: ...


def divide(
    dataset: WithSplits, way: str, train_fraction: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Indices (rest, test), way "sample" or "instance": as the data set stores it, else drawn by `rng`.

    The stored split has TRAIN_FRACTION; another `train_fraction` is drawn, and so is a split of chosen samples of which
    a class has none on one side.
    """
    test = dataset.test.get(way)
    if test is not None and train_fraction == TRAIN_FRACTION:
        pairs = np.unique(np.stack([dataset.labels, test], axis=1), axis=0)
        if len(pairs) == 2 * len(np.unique(dataset.labels)):
            return np.flatnonzero(~test), np.flatnonzero(test)
    return (split_by_sample if way == "sample" else split_by_instance)(dataset, train_fraction, rng)


def split_by_sample(
    dataset: Labelled, first_fraction: float, rng: np.random.Generator, among: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Two sorted index arrays; `first_fraction` of each instance's samples.

    Instances of a single sample are taken together by class, and so is a class whose instances have too few for the
    second part to get one; all samples, where classes have too few.

    `among` restricts both to these indices. Every instance may be on both sides: objects are seen, views are not.
    """
    among = np.arange(len(dataset.labels)) if among is None else among
    labels, instances = dataset.labels[among], dataset.instances[among]
    _, place, counts = np.unique(instances, return_inverse=True, return_counts=True)
    of_class = instances.max(initial=0) + 1 + labels
    strata = np.where(counts[place.reshape(-1)] > 1, instances, of_class)
    for label in np.unique(labels):
        _, sizes = np.unique(strata[labels == label], return_counts=True)
        if all(round(first_fraction * size) == size for size in sizes.tolist()):
            strata[labels == label] = of_class[labels == label]
    parts = [among[strata == stratum] for stratum in np.unique(strata)]
    if all(round(first_fraction * len(part)) == len(part) for part in parts):
        parts = [among]
    return _first_of_each(among, parts, first_fraction, rng)


def split_by_instance(
    dataset: Labelled, first_fraction: float, rng: np.random.Generator, among: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Two sorted index arrays of which no instance is on both sides, nor one and a deformed copy of it; at least one
    instance of each class on each.

    Raises DatasetError where a class has a single instance.
    """
    among = np.arange(len(dataset.labels)) if among is None else among
    first: list[np.ndarray] = []
    for label, name in enumerate(dataset.classes):
        things = np.unique(dataset.things[among][dataset.labels[among] == label])
        if len(things) < 2:
            copies = "" if dataset.things is dataset.instances else ", its deformed copies aside"
            raise DatasetError(f"cannot split by instance: class {name!r} has {len(things)} instance(s){copies}")
        n_first = min(max(round(first_fraction * len(things)), 1), len(things) - 1)
        first.append(rng.permutation(things)[:n_first])
    in_first = np.isin(dataset.things[among], np.concatenate(first))
    return among[in_first], among[~in_first]


def _first_of_each(
    among: np.ndarray, strata: list[np.ndarray], first_fraction: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    first = np.concatenate([rng.permutation(part)[: round(first_fraction * len(part))] for part in strata])
    return np.sort(first), np.setdiff1d(among, first)


def write_splits(
    directory: str | os.PathLike[str], dataset: Labelled, seed: int, official: np.ndarray | None = None
) -> None:
    """Draw both splits of all samples, three quarters of them train, and write DIR/splits.json atomically.

    official: (n,) bool, true for test, where the data come with a split of their own.
    """
    test: dict[str, list[int]] = {}
    ways = {"sample": split_by_sample, "instance": split_by_instance}
    for number, (name, divide) in enumerate(ways.items()):
        try:
            test[name] = divide(dataset, TRAIN_FRACTION, np.random.default_rng((seed, number)))[1].tolist()
        except DatasetError:
            continue  # one instance a class
    if official is not None:
        test["official"] = np.flatnonzero(official).tolist()
    content = {"schema_version": _SCHEMA_VERSION, "seed": seed, "train_fraction": TRAIN_FRACTION, "test": test}
    write_json(Path(directory) / SPLITS_NAME, content, indent=None)


def read_splits(directory: str | os.PathLike[str], n_samples: int) -> Mapping[str, np.ndarray]:
    """The stored splits by name, (n_samples,) bool, true for test; none where the directory has no such file.

    Raises DatasetError where the file is broken or speaks of samples that do not exist.
    """
    path = Path(directory) / SPLITS_NAME
    if not path.is_file():
        return {}
    try:
        content: dict[str, Any] = json.loads(path.read_text())
        if content["schema_version"] != _SCHEMA_VERSION:
            raise DatasetError(f"{path} has schema version {content['schema_version']}, not {_SCHEMA_VERSION}")
        masks = {}
        for name, indices in content["test"].items():
            masks[name] = np.zeros(n_samples, bool)
            masks[name][np.array(indices, np.int64)] = True
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        if isinstance(error, DatasetError):
            raise
        raise DatasetError(f"{path} is not a list of splits of {n_samples} samples: {error!r}; remove it") from error
    return masks
