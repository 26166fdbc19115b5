"""The clouds of a run, split and prepared, on the device that trains."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from pec.data.loading import data_version, load_dataset
from pec.data.tensor_dataset import PreparedClouds, prepare
from pec.errors import DatasetError
from pec.training.config import TrainConfig
from pec.training.run_split import split

__all__ = ["RunData", "load_run_data"]


@dataclass(frozen=True)
class RunData:
    """version: of the data set, as `pec.data.loading.data_version`. selection: what chooses the epoch."""

    classes: list[str]
    version: str
    training: PreparedClouds
    selection: PreparedClouds
    test: PreparedClouds


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
    if len(dataset.classes) < 2:
        raise DatasetError(f"{config.dataset.path} has the single class {dataset.classes[0]!r}: nothing to tell apart")
    parts = split(dataset, config.dataset, config.protocol.selection, config.seed)
    for name, part in zip(("training", "choosing the epoch", "testing"), parts, strict=True):
        if not len(part):
            raise DatasetError(f"{config.dataset.path}: {len(dataset)} clouds leave none for {name}: give more of them")
    prepared = prepare(
        dataset,
        config.preprocess,
        removed=config.dataset.removed,
        seed=config.seed,
        cache=config.cache,
        progress=config.progress,
    )
    training, selection, test = (prepared.subset(part).to(device) for part in parts)
    return RunData(dataset.classes, version, training, selection, test)
