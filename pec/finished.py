"""Finished training runs, as those read them who measure them again: the settings, the best checkpoint, the data."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pec.checkpoint import Checkpoint, read_checkpoint
from pec.clouds import CloudDataset, load_dataset
from pec.config import TrainConfig, read_config
from pec.errors import CheckpointError
from pec.training import split

__all__ = ["FinishedRun", "read_finished"]


@dataclass(frozen=True)
class FinishedRun:
    """test: indices (n,) of `dataset`'s clouds that the run was tested on."""

    config: TrainConfig
    checkpoint: Checkpoint
    dataset: CloudDataset
    test: np.ndarray


def read_finished(run: Path, data: str | None = None) -> FinishedRun:
    """The run whose output folder is `run`, with its best checkpoint. data: where its clouds lie, if they have moved.

    Raises CheckpointError where the folder holds no finished run, or DatasetError.
    """
    path = run / "results.json"
    if not path.is_file():
        raise CheckpointError(f"{run} holds no finished training run: {path} does not exist")
    settings = json.loads(path.read_text())["config"]
    if data is not None:
        settings["dataset"]["path"] = data
    config = read_config({**settings, "output": str(run)})
    checkpoint = read_checkpoint(run / "best")
    dataset = load_dataset(
        config.dataset.path,
        checkpoint.classes,
        config.dataset.samples_per_instance,
        checkpoint.preprocess.n_points,
        config.dataset.size,
    )
    test = split(dataset, config.dataset, "validation", config.seed)[2]
    return FinishedRun(config, checkpoint, dataset, test)
