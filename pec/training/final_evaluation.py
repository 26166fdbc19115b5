"""What a finished run is worth: calibration on the selection split, then one look at the test split a checkpoint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pec.checkpoint import Checkpoint, read_checkpoint, read_training_state, write_checkpoint
from pec.data.augment import augment
from pec.data.tensor_dataset import PreparedClouds
from pec.known.form_witness import FormWitness
from pec.metrics.calibration import fit_temperature
from pec.metrics.predictions import among_known, predict_log_probabilities
from pec.metrics.scores import Scores, score
from pec.training.config import TrainConfig
from pec.training.costs import measure_costs
from pec.training.form_fit import fit_witness, network_weight, numbers_of
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
            checkpoint = with_knowing(calibrated(checkpoint, config, data), data)
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
                **_weights(checkpoint),
                **figures_on_test(checkpoint, data),
            }
            tracker.final(name, checkpoint, scores)
            if name == "best":
                tracker.misclassified(checkpoint, known, answers.argmax(dim=1))
                best = checkpoint
        costs = measure_costs(best).as_dict()
        tracker.settings(config, costs, {f"test_accuracy/{name}": results[name]["test_accuracy"] for name in results})
    return {**results, "costs": costs}


def calibrated(checkpoint: Checkpoint, config: TrainConfig, data: RunData) -> Checkpoint:
    """With what the network counts beside the witness of forms fitted on the calibration split, and the temperature on
    the selection split, as they may be met: augmented like the training split.

    On undamaged clouds of known instances nearly every answer is right, and no confidence would be too high.
    """
    generator = torch.Generator().manual_seed(config.seed)
    augmented = _damaged(data.selection, config, generator).of_known(len(checkpoint.classes))
    if checkpoint.forms is not None:
        checkpoint = replace(checkpoint, forms=_weighed(checkpoint, _damaged(data.calibration, config, generator)))
    log_probabilities = among_known(_predict(checkpoint, augmented), len(checkpoint.classes))
    temperature = fit_temperature(log_probabilities, augmented.labels)
    return replace(checkpoint, temperature=temperature)


def _weights(checkpoint: Checkpoint) -> dict[str, float]:
    """What results.json says of the two witnesses, where there are two."""
    return {} if checkpoint.forms is None else {"network_weight": float(checkpoint.forms.network_weight[0])}


def _damaged(clouds: PreparedClouds, config: TrainConfig, generator: torch.Generator) -> PreparedClouds:
    points, valid = augment(clouds.candidates, clouds.valid, config.augment, generator)
    return replace(clouds, candidates=points, valid=valid)


def _weighed(checkpoint: Checkpoint, clouds: PreparedClouds) -> FormWitness:
    """The checkpoint's witness with the network's weight beside it, by clouds of things that neither learnt from; by
    strangers, too, where there is an output for them."""
    assert checkpoint.forms is not None
    clouds = clouds.of_known(checkpoint.n_outputs)
    by_network = _predict(replace(checkpoint, forms=None), clouds).cpu().double().numpy()
    by_form = checkpoint.forms.log_probabilities(numbers_of(clouds.candidates, clouds.valid))
    weight = network_weight(by_network, by_form, clouds.labels.cpu().numpy(), clouds.things.cpu().numpy())
    return replace(checkpoint.forms, network_weight=np.array([weight]))


def _scores(checkpoint: Checkpoint, clouds: PreparedClouds) -> Scores:
    return score(_predict(checkpoint, clouds), clouds.labels, n_classes=len(checkpoint.classes))


def _predict(checkpoint: Checkpoint, clouds: PreparedClouds) -> torch.Tensor:
    parts = checkpoint.model, checkpoint.preprocess, clouds.candidates, clouds.valid, checkpoint.forms
    return predict_log_probabilities(*parts)
