"""What a finished run is worth: calibration on the selection split, then one look at the test split a checkpoint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from pec.checkpoint import Checkpoint, read_checkpoint, read_training_state, write_checkpoint
from pec.data.augment import augment
from pec.data.tensor_dataset import PreparedClouds
from pec.metrics import fit_temperature, predict_log_probabilities, rejection_threshold, score
from pec.training.config import TrainConfig
from pec.training.costs import measure_costs
from pec.training.tensorboard import Tracker

__all__ = ["report"]


def report(
    output: Path, config: TrainConfig, training: PreparedClouds, selection: PreparedClouds, test: PreparedClouds
) -> dict[str, Any]:
    """Calibrate OUTPUT/best and OUTPUT/last, score them, and show in OUTPUT/tensorboard what can be seen.

    Returns what results.json says of the two, and `costs`, those of best.
    """
    results: dict[str, Any] = {}
    with Tracker(output / "tensorboard", None) as tracker:
        for name in ("best", "last"):
            state = read_training_state(output / name) if name == "last" else None
            checkpoint = read_checkpoint(output / name)
            checkpoint.model.to(test.candidates.device)
            checkpoint = _calibrated(checkpoint, config, selection)
            write_checkpoint(output / name, checkpoint, state)
            log_probabilities = _predict(checkpoint, test)
            scores = score(log_probabilities, test.labels, checkpoint.temperature)
            confidence = (log_probabilities / checkpoint.temperature).softmax(dim=1).amax(dim=1)
            results[name] = {
                "epoch": checkpoint.epoch,
                "train_accuracy": score(_predict(checkpoint, training), training.labels).accuracy,
                "selection_accuracy": score(_predict(checkpoint, selection), selection.labels).accuracy,
                "test_accuracy": scores.accuracy,
                "test_loss": scores.loss,
                "test_per_class": dict(zip(checkpoint.classes, scores.per_class, strict=True)),
                "test_confusion": scores.confusion,
                "test_calibration_error": scores.calibration_error,
                "temperature": checkpoint.temperature,
                "unknown_below": checkpoint.unknown_below,
                "test_called_unknown": (confidence < checkpoint.unknown_below).double().mean().item(),
            }
            tracker.final(name, checkpoint, scores)
            if name == "best":
                tracker.misclassified(checkpoint, test, log_probabilities.argmax(dim=1))
                best = checkpoint
        costs = measure_costs(best).as_dict()
        tracker.settings(config, costs, {f"test_accuracy/{name}": results[name]["test_accuracy"] for name in results})
    return {**results, "costs": costs}


def _calibrated(checkpoint: Checkpoint, config: TrainConfig, selection: PreparedClouds) -> Checkpoint:
    """With temperature and threshold fitted on the selection split as it may be met: augmented like the training split.

    On undamaged clouds of known instances nearly every answer is right, and no confidence would be too high.
    """
    generator = torch.Generator().manual_seed(config.seed)
    points, valid = augment(selection.candidates, selection.valid, config.augment, generator)
    log_probabilities = _predict(checkpoint, replace(selection, candidates=points, valid=valid))
    temperature = fit_temperature(log_probabilities, selection.labels)
    confidence = (log_probabilities / temperature).softmax(dim=1).amax(dim=1)
    return replace(checkpoint, temperature=temperature, unknown_below=rejection_threshold(confidence))


def _predict(checkpoint: Checkpoint, clouds: PreparedClouds) -> torch.Tensor:
    return predict_log_probabilities(checkpoint.model, checkpoint.preprocess, clouds.candidates, clouds.valid)
