"""The clouds of a run, split and prepared, on the device that trains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from pec.data.dataset import UNKNOWN, CloudDataset
from pec.data.loading import data_version, load_dataset
from pec.data.made_strangers import made_strangers
from pec.data.tensor_dataset import PreparedClouds, prepare
from pec.errors import DatasetError
from pec.training.config import TrainConfig
from pec.training.run_split import Parts, hold_out_instances, split

__all__ = ["RunData", "load_run_data"]


@dataclass(frozen=True)
class RunData:
    """classes: UNKNOWN the last where there are strangers. version: of the data set, as
    `pec.data.loading.data_version`. selection: what chooses the epoch. calibration: what sets the threshold of the
    unknown; seen: the classes whose instances in it are ones that training sees."""

    classes: list[str]
    version: str
    training: PreparedClouds
    selection: PreparedClouds
    test: PreparedClouds
    calibration: PreparedClouds
    seen: list[str]

    @property
    def n_known(self) -> int:
        """Classes without UNKNOWN."""
        return sum(name != UNKNOWN for name in self.classes)


def load_run_data(config: TrainConfig, device: torch.device) -> RunData:
    """Raises DatasetError where there is nothing to tell apart, or none for one of the three purposes."""
    version = data_version(config.dataset.path)
    dataset = load_dataset(
        config.dataset.path,
        config.dataset.classes,
        config.dataset.samples_per_instance,
        config.preprocess.n_points,
        config.dataset.size,
    )
    if len(dataset.known_classes) < 2:
        names = ", ".join(map(repr, dataset.known_classes))
        raise DatasetError(f"{config.dataset.path} has the single class {names}: nothing to tell apart")
    parts = split(dataset, config.dataset, config.protocol.selection, config.seed)
    for name, part in zip(("training", "choosing the epoch", "testing"), parts, strict=True):
        if not len(part):
            raise DatasetError(f"{config.dataset.path}: {len(dataset)} clouds leave none for {name}: give more of them")
    honest = config.protocol.selection == "validation"
    divided = hold_out_instances(dataset, parts, config.dataset.calibration_fraction if honest else 0.0, config.seed)
    n_known = len(dataset.known_classes)
    dataset, divided = _with_made_strangers(dataset, divided, config)
    prepared = prepare(
        dataset,
        config.preprocess,
        removed=config.dataset.removed,
        seed=config.seed,
        cache=config.cache,
        progress=config.progress,
    )
    training, selection, test, calibration = (
        prepared.subset(part).to(device)
        for part in (divided.training, divided.selection, divided.test, divided.calibration)
    )
    refuses = bool((training.labels == n_known).any())
    classes = [*dataset.known_classes, UNKNOWN] if refuses else dataset.known_classes
    return RunData(classes, version, training, selection, test, calibration, divided.seen)


def _with_made_strangers(dataset: CloudDataset, parts: Parts, config: TrainConfig) -> tuple[CloudDataset, Parts]:
    """With strangers made of the clouds of each part but test, where fewer are given than asked for.

    Calibration gets some where it would have none: it needs strangers to tell the known from.
    """
    n_known = len(dataset.known_classes)
    extra: list[np.ndarray] = []
    more: dict[str, Any] = {}
    rng = np.random.default_rng((config.seed, 0x57A6))
    for name in ("training", "selection", "calibration"):
        indices = getattr(parts, name)
        known = indices[dataset.labels[indices] < n_known]
        given = len(indices) - len(known)
        n = max(round(config.protocol.made_strangers * len(known)) - given, 0)
        if name == "calibration" and n + given == 0:
            n = len(known)
        made = made_strangers([dataset.cloud(i) for i in known], n, config.preprocess.n_points, rng)
        begin = len(dataset) + len(extra)
        more[name] = np.concatenate([indices, np.arange(begin, begin + len(made))])
        extra += made
    if not extra:
        return dataset, parts
    n, first = len(extra), int(dataset.instances.max()) + 1
    joined = CloudDataset(
        dataset.classes,
        [*dataset.clouds, *extra],
        np.concatenate([dataset.labels, np.full(n, n_known)]),
        np.concatenate([dataset.instances, np.arange(first, first + n)]),
        f"{dataset.fingerprint} and {n} made strangers of seed {config.seed}",
    )
    return joined, replace(parts, **more)
