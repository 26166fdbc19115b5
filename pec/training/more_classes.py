"""Classes that are learnt after the others, in minutes: a finished run goes on from its weights with more classes.

All weights learn, from the clouds of the run and the new ones together, so that nothing is forgotten; the new classes'
outputs begin as the mean of the others'. What tells the known from strangers is fitted anew, as at the end of a run.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from pec.checkpoint import Checkpoint
from pec.classifier import Classifier
from pec.common.threads import torch_threads
from pec.data.dataset import UNKNOWN
from pec.data.tensor_dataset import PreparedClouds
from pec.errors import CheckpointError, CloudError, ConfigError
from pec.networks.registry import build_model
from pec.preprocessing.preprocess import Preprocess
from pec.training.epoch import Epochs
from pec.training.final_evaluation import calibrated
from pec.training.finished_runs import FinishedRun, read_finished
from pec.training.form_fit import fit_witness
from pec.training.knowing_fit import with_knowing
from pec.training.run_data import RunData, load_run_data

__all__ = ["epochs_for", "fit", "run_to_go_on", "with_outputs"]

_SPARED = 5  # of the new clouds of a class every fifth is not learnt: it sets thresholds
_FEWEST = 5
_EPOCHS, _FEWEST_EPOCHS, _MOST_PASSES = 10, 3, 60_000
_RATE = 0.5  # of the run's own learning rate: the weights are good already


def fit(
    run: str | os.PathLike[str],
    clouds: Mapping[str, Sequence[np.ndarray]],
    *,
    data: str | None = None,
    epochs: int | None = None,
    seed: int = 0,
    progress: bool = False,
) -> Classifier:
    """A classifier that knows the classes of a finished run and new ones, trained for some minutes on a CPU.

    run: output folder of `pecgrasp train`, whose clouds are learnt along, so they must still lie where they were, or in
    `data`. clouds: of each new class its clouds (N, 3), metres, as the camera gives them, of one or several things;
    five at least, some dozens are better; for fewer, `Classifier.enrol`. They count as much as the clouds of a class of
    the run. epochs: passes over all; None: ten, or fewer, three at least, where ten were more than 60,000 clouds, which
    take some two minutes of a core. seed: of all draws. `Classifier.save` keeps what is returned.
    Raises ConfigError where a name is empty, reserved or taken, CloudError where clouds are too few or bad,
    CheckpointError where `run` holds no finished run or one that cannot go on, DatasetError where its clouds are gone.
    """
    finished = run_to_go_on(run, data)
    checkpoint, config = finished.checkpoint, finished.config
    _check_names(clouds, checkpoint.classes)
    protocol = replace(config.protocol, learning_rate=_RATE * config.protocol.learning_rate)
    with torch_threads(config.threads):
        old = load_run_data(replace(finished.config, progress=progress), torch.device("cpu"))
        joined = _with_classes(old, clouds, checkpoint.preprocess, seed)
        epochs = epochs_for(len(joined.training)) if epochs is None else epochs
        config = replace(config, seed=seed, protocol=replace(protocol, epochs=epochs))
        model = with_outputs(checkpoint, len(joined.classes))
        learning = Epochs(config, joined.training, len(joined.classes))
        optimizer = torch.optim.AdamW(model.parameters(), weight_decay=config.protocol.weight_decay, fused=True)
        for epoch in tqdm(range(epochs), desc="training", unit="epoch", disable=not progress, leave=False):
            learning.run(model, optimizer, epoch, "float32")
        more = replace(
            checkpoint,
            model=model.eval(),
            classes=[name for name in joined.classes if name != UNKNOWN],
            epoch=checkpoint.epoch + epochs,
        )
        if checkpoint.forms is not None:
            more = replace(more, forms=fit_witness(joined.training, len(joined.classes), config.augment, seed))
        return Classifier(with_knowing(calibrated(more, config, joined), joined), seed)


def epochs_for(n_clouds: int) -> int:
    """How often `fit` learns so many clouds where nobody says it."""
    return max(_FEWEST_EPOCHS, min(_EPOCHS, _MOST_PASSES // n_clouds))


def run_to_go_on(run: str | os.PathLike[str], data: str | None = None) -> FinishedRun:
    """The finished run with which `fit` can go on. run, data and errors about them: as of `fit`."""
    finished = read_finished(Path(run), data)
    checkpoint = finished.checkpoint
    if not any(parameter.requires_grad for parameter in checkpoint.model.parameters()):
        raise CheckpointError(f"{run}: the network {checkpoint.network} has nothing to train; use Classifier.enrol")
    with_outputs(checkpoint, checkpoint.n_outputs + 1)
    return finished


def _check_names(clouds: Mapping[str, Sequence[np.ndarray]], taken: Sequence[str]) -> None:
    if not clouds:
        raise ConfigError("clouds holds no class to be learnt")
    for name, of_class in clouds.items():
        if not name or name == UNKNOWN:
            raise ConfigError(f"a class cannot be called {name!r}")
        if name in taken:
            raise ConfigError(f"there is a class {name!r} already; the classes are {', '.join(taken)}")
        if len(of_class) < _FEWEST:
            raise CloudError(
                f"class {name!r} has {len(of_class)} clouds, training needs {_FEWEST}; Classifier.enrol needs only one"
            )


def _with_classes(
    data: RunData, clouds: Mapping[str, Sequence[np.ndarray]], preprocess: Preprocess, seed: int
) -> RunData:
    """The clouds of a run and those of new classes, which come after the others and before the strangers."""
    n_old, n_new = data.n_known, len(clouds)
    usual = int(data.training.labels.bincount()[:n_old].double().median())
    parts = {name: [_moved_up(getattr(data, name), n_old, n_new)] for name in ("training", "selection", "calibration")}
    rng = np.random.default_rng((seed, 0xF17))
    for place, (class_name, of_class) in enumerate(clouds.items()):
        samples = []
        for number, cloud in enumerate(of_class):
            try:
                samples.append(preprocess.sample(cloud, rng))
            except CloudError as error:
                raise CloudError(f"class {class_name!r}, cloud {number}: {error}") from error
        spared = [number % _SPARED == _SPARED - 1 for number in range(len(samples))]
        learnt = [sample for sample, spare in zip(samples, spared, strict=True) if not spare]
        # As often as the clouds of another class; each time they are damaged in another way.
        learnt *= max(1, round(usual / len(learnt)))
        kept = [sample for sample, spare in zip(samples, spared, strict=True) if spare]
        for name, few in (("training", learnt), ("selection", kept), ("calibration", kept)):
            parts[name].append(_prepared(few, n_old + place, place, preprocess.n_candidates, data))
    classes = [*data.classes[:n_old], *clouds, *data.classes[n_old:]]
    training, selection, calibration = (PreparedClouds.joined(parts[name]) for name in parts)
    return RunData(
        classes, data.version, training, selection, _moved_up(data.test, n_old, n_new), calibration, data.seen
    )


def _moved_up(clouds: PreparedClouds, n_old: int, n_new: int) -> PreparedClouds:
    """Strangers' labels make room for those of new classes."""
    labels = torch.where(clouds.labels >= n_old, clouds.labels + n_new, clouds.labels)
    return replace(clouds, labels=labels)


def _prepared(samples: list[np.ndarray], label: int, thing: int, n_candidates: int, data: RunData) -> PreparedClouds:
    candidates = torch.zeros(len(samples), n_candidates, 3)
    for row, sample in zip(candidates, samples, strict=True):
        row[: len(sample)] = torch.from_numpy(sample)
    counts = torch.tensor([len(sample) for sample in samples])
    first = 1 + max(int(part.instances.max()) for part in (data.training, data.selection, data.calibration, data.test))
    number = torch.full((len(samples),), first + thing)
    valid = torch.arange(n_candidates) < counts[:, None]
    return PreparedClouds(candidates, valid, torch.full_like(number, label), number, number)


def with_outputs(checkpoint: Checkpoint, n_outputs: int) -> nn.Module:
    """The network with so many outputs: its own first, then new ones, "none of these" the last as before.

    Raises CheckpointError where more than its last layers depends on how many there are.
    """
    n_known, n_before = len(checkpoint.classes), checkpoint.n_outputs
    model = build_model(checkpoint.network, checkpoint.preprocess.n_points, n_outputs)
    state = dict(checkpoint.model.state_dict())
    for name, new in model.state_dict().items():
        old = state[name]
        if old.shape == new.shape:
            continue
        if old.shape[0] != n_before or new.shape[0] != n_outputs or old.shape[1:] != new.shape[1:]:
            raise CheckpointError(
                f"{name} of the network {checkpoint.network} has shape {tuple(old.shape)} of {n_before} outputs and "
                f"{tuple(new.shape)} of {n_outputs}: only networks whose last layers alone depend on them can go on"
            )
        mean = old[:n_known].mean(dim=0, keepdim=True)
        fresh = mean.expand(n_outputs - n_before, *old.shape[1:])
        state[name] = torch.cat([old[:n_known], fresh, old[n_known:]])
    model.load_state_dict(state)
    return model
