"""Training: one loop, an honest protocol and the published one, and runs that go on where they were killed.

Every random draw of epoch e comes from a generator seeded by (seed, e), and the state is saved after each epoch, so a
run that is killed and started again ends in the same weights, bit for bit on a CPU with the same number of threads.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from pec.common.atomic_files import write_json
from pec.common.devices import device_named
from pec.common.threads import torch_threads
from pec.metrics.predictions import arrange_views, log_probabilities
from pec.metrics.scores import score
from pec.networks.baselines import Memorising
from pec.training.config import TrainConfig, read_config
from pec.training.doubts import doubts, threshold_doubts, witness_doubts
from pec.training.epoch import EpochResult, Epochs, memorise
from pec.training.epoch_bar import epoch_bar
from pec.training.final_evaluation import report
from pec.training.finished_runs import finished_results
from pec.training.precision import Precision, choose_precision
from pec.training.run_data import RunData, load_run_data
from pec.training.run_state import RunState
from pec.training.tensorboard import Tracker

__all__ = ["train"]


def train(cfg: Mapping[str, Any]) -> dict[str, Any]:
    """Train and evaluate as `cfg` says (see `pec.training.config.TrainConfig`).

    Returns what is also written to OUTPUT/results.json. OUTPUT/best and OUTPUT/last are checkpoints, OUTPUT/tensorboard
    the curves. A finished run is not repeated, an interrupted one goes on.
    Raises ConfigError, DatasetError, CheckpointError, or TrainingError where the loss is not finite any more.
    """
    config = read_config(cfg)
    finished = finished_results(config)
    if finished is not None:
        return finished
    with _flushed_denormals(), torch_threads(config.threads):
        device = device_named(config.device)
        data = load_run_data(config, device)
        state = RunState(config, data.classes, data.version, device)
        _fit(config, state, data)
        results = _results(config, state, data, device)
    write_json(Path(config.output) / "results.json", results)
    return results


def _fit(config: TrainConfig, state: RunState, data: RunData) -> None:
    """Train up to the configured epoch, saving after each."""
    epochs = None if state.optimizer is None else Epochs(config, data.training, len(data.classes))
    if epochs and state.epoch == 0 and config.protocol.initial_weights == "scaled":
        epochs.scale_initial_weights(state.model)
    if state.precision is None:
        state.precision = _precision(state, epochs, data)
    inputs = arrange_views(config.preprocess, data.selection.candidates, data.selection.valid)
    with Tracker(Path(config.output) / "tensorboard", state.epoch) as tracker:
        bar = epoch_bar(state.epoch, state.n_epochs, shown=config.progress)
        for epoch in bar:
            begin = time.perf_counter()
            trained = _train_epoch(config, state, epochs, data, epoch)
            scores = score(log_probabilities(state.model, inputs), data.selection.labels, n_classes=data.n_known)
            state.finish_epoch(trained, scores, time.perf_counter() - begin)
            tracker.epoch(
                epoch + 1, trained.loss, trained.accuracy, scores, trained.learning_rate, data.classes[: data.n_known]
            )
            bar.set_postfix(
                loss=f"{trained.loss:.3f}", train=f"{trained.accuracy:.3f}", selection=f"{scores.accuracy:.3f}"
            )


def _precision(state: RunState, epochs: Epochs | None, data: RunData) -> Precision:
    """What precision=auto means for this run: measured, where there is something to measure."""
    if epochs is None or len(data.training) < 2:
        return Precision("auto", "float32")
    return choose_precision(epochs.trial(state.model), data.training.labels.device)


def _train_epoch(config: TrainConfig, state: RunState, epochs: Epochs | None, data: RunData, epoch: int) -> EpochResult:
    if epochs is None:
        assert isinstance(state.model, Memorising)
        return memorise(state.model, config, data.training)
    assert state.optimizer is not None
    assert state.precision is not None
    return epochs.run(state.model, state.optimizer, epoch, state.precision.used)


def _results(config: TrainConfig, state: RunState, data: RunData, device: torch.device) -> dict[str, Any]:
    """What the run was, and what `report` says of its checkpoints: only here is the test split read."""
    output = Path(config.output)
    honest = config.protocol.selection == "validation"
    assert state.precision is not None
    results = report(output, config, data)
    return {
        "protocol": "honest: epoch chosen on validation, test read once"
        if honest
        else "published: best epoch on the evaluation split itself, an optimistic figure",
        "classes": data.classes[: data.n_known],
        "parameters": sum(parameter.numel() for parameter in state.model.parameters()),
        "epochs": state.epoch,
        "seed": config.seed,
        "training_s": round(state.seconds, 2),
        "device": str(device),
        "threads": config.threads,
        "checkpoint": str(output / "best"),
        "config": config.decisive(),
        "data": data.version,
        "precision": state.precision.as_dict(),
        **results,
        "warnings": [
            *doubts(
                config, data.training.of_known(data.n_known).labels, state.history["train_accuracy"], results["best"]
            ),
            *witness_doubts(results["best"]),
            *(threshold_doubts(data.seen) if honest else ()),
        ],
        "threshold_on_seen": data.seen,
        "curves": state.history,
        "n_samples": {
            "train": len(data.training),
            "selection": len(data.selection),
            "calibration": len(data.calibration),
            "test": len(data.test),
            "strangers_in_training": int((data.training.labels == data.n_known).sum()),
        },
    }


@contextmanager
def _flushed_denormals() -> Iterator[None]:
    torch.set_flush_denormal(True)  # weights that decay towards zero otherwise slow a CPU down many times
    try:
        yield
    finally:
        torch.set_flush_denormal(False)  # it holds for all arithmetic of the process, the caller's too
