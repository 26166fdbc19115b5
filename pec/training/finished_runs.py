"""Training runs that are there already: whether one is the same as another, and what a finished one holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pec.checkpoint import Checkpoint, read_checkpoint
from pec.common.run_identity import first_difference
from pec.data.dataset import CloudDataset
from pec.data.loading import data_version, load_dataset
from pec.errors import CheckpointError, ConfigError, DatasetError
from pec.training.config import TrainConfig, read_config
from pec.training.run_split import split

__all__ = ["FinishedRun", "check_same", "finished_results", "read_finished"]


def finished_results(config: TrainConfig) -> dict[str, Any] | None:
    """The results of a finished run in the output folder; None where there is none, ConfigError where it is another."""
    path = Path(config.output) / "results.json"
    if not path.is_file():
        return None
    results: dict[str, Any] = json.loads(path.read_text())
    check_same(config, data_version(config.dataset.path), results)
    return results


def check_same(config: TrainConfig, data: str, earlier: Mapping[str, Any]) -> None:
    """ConfigError where `earlier`, with its "config" and "data", had other settings, or data of another version."""
    before = earlier["config"]
    recorded = earlier.get("data")  # an older version of this package wrote none
    if data == recorded:
        before = before | {"dataset": before["dataset"] | {"path": config.dataset.path}}  # wherever they lie
    difference = first_difference(before, config.decisive())
    if difference is None and recorded and data not in ("missing", recorded):  # what is done stays so without its data
        difference = f"other data: {config.dataset.path} has changed since"
    if difference is None:
        return
    raise ConfigError(f"output {config.output} holds a run with {difference}: choose another output, or delete it")


@dataclass(frozen=True)
class FinishedRun:
    """data: version of the data set. test: the clouds of the known classes that the run was tested on, undamaged
    (`dataset.removed`).
    places: theirs among all clouds that the data set's files hold."""

    config: TrainConfig
    checkpoint: Checkpoint
    data: str
    test: CloudDataset
    places: list[int]


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
    if results.get("data") not in (None, version):  # as in check_same
        raise DatasetError(f"{run} was trained on other data than {config.dataset.path} holds now")
    checkpoint = read_checkpoint(run / "best")
    dataset = load_dataset(
        config.dataset.path,
        config.dataset.classes,
        config.dataset.samples_per_instance,
        checkpoint.preprocess.n_points,
        config.dataset.size,
    )
    tested = split(dataset, config.dataset, "validation", config.seed)[2]
    test = replace(dataset.subset(tested[dataset.is_known[tested]]), classes=checkpoint.classes)
    assert test.stored is not None  # it was loaded
    return FinishedRun(config, checkpoint, version, test, test.stored.tolist())
