"""Finished training runs, as those read them who measure them again: the settings, the best checkpoint, the data."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from pec.checkpoint import Checkpoint, read_checkpoint
from pec.clouds import CloudDataset, data_version, load_dataset
from pec.config import TrainConfig, read_config
from pec.errors import CheckpointError, DatasetError
from pec.training import split

__all__ = ["FinishedRun", "read_finished"]


@dataclass(frozen=True)
class FinishedRun:
    """data: version of the data set. test: the clouds that the run was tested on, undamaged (`dataset.removed`)."""

    config: TrainConfig
    checkpoint: Checkpoint
    data: str
    test: CloudDataset


def read_finished(run: Path, data: str | None = None) -> FinishedRun:
    """The run whose output folder is `run`, with its best checkpoint. data: where its clouds lie, if they have moved.

    Raises CheckpointError where the folder holds no finished run, DatasetError where its data are gone or others.
    """
    path = run / "results.json"
    if not path.is_file():
        raise CheckpointError(f"{run} holds no finished training run: {path} does not exist")
    results = json.loads(path.read_text())
    if not {"config", "best"} <= results.keys():
        raise CheckpointError(f"{path} is of something else than a training run; a grid's runs are its cells/KEY")
    settings = results["config"]
    if data is not None:
        settings["dataset"]["path"] = data
    config = read_config({**settings, "output": str(run)})
    version = data_version(config.dataset.path)
    if results.get("data") not in (None, version):  # None: an older version of this package wrote none
        raise DatasetError(f"{run} was trained on other data than {config.dataset.path} holds now")
    checkpoint = read_checkpoint(run / "best")
    dataset = load_dataset(
        config.dataset.path,
        checkpoint.classes,
        config.dataset.samples_per_instance,
        checkpoint.preprocess.n_points,
        config.dataset.size,
    )
    test = split(dataset, config.dataset, "validation", config.seed)[2]
    return FinishedRun(config, checkpoint, version, dataset.subset(test))
