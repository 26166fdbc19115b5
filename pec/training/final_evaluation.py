"""What a finished run is worth: calibration on the selection split, then one look at the test split a checkpoint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from pec.checkpoint import Checkpoint, read_checkpoint, read_training_state, write_checkpoint
from pec.data.augment import augment
from pec.data.tensor_dataset import PreparedClouds
from pec.metrics.calibration import fit_temperature
from pec.metrics.predictions import among_known, predict_log_probabilities
from pec.metrics.scores import Scores, score
from pec.training.config import TrainConfig
from pec.training.costs import measure_costs
from pec.training.form_fit import fit_witness
from pec.training.knowing_fit import figures_on_test, with_knowing
from pec.training.run_data import RunData
from pec.training.tensorboard import Tracker

__all__ = ["calibrated", "report"]


def report(output: Path, config: TrainConfig, data: RunData) -> dict[str, Any]:
    """Calibrate OUTPUT/best and OUTPUT/last, score them, and show in OUTPUT/tensorboard what can be seen.

    Returns what results.json says of the two, and `costs`, those of best.
    """
    results: dict[str, Any] = {}
    known = data.test.of_known(data.n_known)
    witness = None
    if config.protocol.surface_forms:
        witness = fit_witness(data.training, len(data.classes), config.augment, config.seed)
    with Tracker(output / "tensorboard", None) as tracker:
        for name in ("best", "last"):
            state = read_training_state(output / name) if name == "last" else None
            checkpoint = read_checkpoint(output / name)
            checkpoint.model.to(known.candidates.device)
            checkpoint = replace(checkpoint, forms=witness)
            checkpoint = with_knowing(calibrated(checkpoint, config, data.selection), data)
            write_checkpoint(output / name, checkpoint, state)
            log_probabilities = _predict(checkpoint, data.test)
            scores = score(log_probabilities, data.test.labels, checkpoint.temperature, data.n_known)
            answers = among_known(log_probabilities[data.test.labels < data.n_known], data.n_known)
            results[name] = {
                "epoch": checkpoint.epoch,
                "train_accuracy": _scores(checkpoint, data.training).accuracy,
                "selection_accuracy": _scores(checkpoint, data.selection).accuracy,
                "test_accuracy": scores.accuracy,
                "test_loss": scores.loss,
                "test_per_class": dict(zip(checkpoint.classes, scores.per_class, strict=True)),
                "test_confusion": scores.confusion,
                "test_calibration_error": scores.calibration_error,
                "temperature": checkpoint.temperature,
                **figures_on_test(checkpoint, data),
            }
            tracker.final(name, checkpoint, scores)
            if name == "best":
                tracker.misclassified(checkpoint, known, answers.argmax(dim=1))
                best = checkpoint
        costs = measure_costs(best).as_dict()
        tracker.settings(config, costs, {f"test_accuracy/{name}": results[name]["test_accuracy"] for name in results})
    return {**results, "costs": costs}


def calibrated(checkpoint: Checkpoint, config: TrainConfig, selection: PreparedClouds) -> Checkpoint:
    """With the temperature fitted on the selection split as it may be met: augmented like the training split.

    On undamaged clouds of known instances nearly every answer is right, and no confidence would be too high.
    """
    generator = torch.Generator().manual_seed(config.seed)
    points, valid = augment(selection.candidates, selection.valid, config.augment, generator)
    augmented = replace(selection, candidates=points, valid=valid).of_known(len(checkpoint.classes))
    log_probabilities = among_known(_predict(checkpoint, augmented), len(checkpoint.classes))
    temperature = fit_temperature(log_probabilities, augmented.labels)
    return replace(checkpoint, temperature=temperature)


def _scores(checkpoint: Checkpoint, clouds: PreparedClouds) -> Scores:
    return score(_predict(checkpoint, clouds), clouds.labels, n_classes=len(checkpoint.classes))


def _predict(checkpoint: Checkpoint, clouds: PreparedClouds) -> torch.Tensor:
    parts = checkpoint.model, checkpoint.preprocess, clouds.candidates, clouds.valid, checkpoint.forms
    return predict_log_probabilities(*parts)
