"""Training: one loop, an honest protocol and the published one, and runs that go on where they were killed.

Every random draw of epoch e comes from a generator seeded by (seed, e), and the state is saved after each epoch, so a
run that is killed and started again ends in the same weights, bit for bit on a CPU with the same number of threads.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import nn
from tqdm import tqdm

from pec.checkpoint import Checkpoint, TrainingState, read_checkpoint, read_training_state, write_checkpoint
from pec.common.atomic_files import write_json
from pec.common.threads import torch_threads
from pec.data.augment import augment
from pec.data.dataset import data_version, load_dataset
from pec.data.tensor_dataset import PreparedClouds, prepare
from pec.errors import ConfigError, DatasetError, TrainingError
from pec.metrics import arrange_views, log_probabilities, score
from pec.networks.baselines import NearestNeighbours, PointNet
from pec.networks.initialise import scale_initial_weights
from pec.networks.registry import build_model
from pec.training.config import TrainConfig, read_config
from pec.training.final_evaluation import report
from pec.training.finished_runs import check_same, finished_results
from pec.training.run_split import split
from pec.training.tensorboard import Tracker

__all__ = ["train"]

_SCALING_CLOUDS = 512  # that initial weights are scaled to
_CURVES = ("train_loss", "train_accuracy", "selection_loss", "selection_accuracy", "learning_rate")


def train(cfg: Mapping[str, Any]) -> dict[str, Any]:
    """Train and evaluate as `cfg` says (see `pec.training.config.TrainConfig`).

    Returns what is also written to OUTPUT/results.json. OUTPUT/best and OUTPUT/last are checkpoints, OUTPUT/tensorboard
    the curves. A finished run is not repeated, an interrupted one goes on.
    Raises ConfigError, DatasetError, CheckpointError, or TrainingError where the loss is not finite any more.
    """
    config = read_config(cfg)
    output = Path(config.output)
    finished = finished_results(config)
    if finished is not None:
        return finished
    torch.set_flush_denormal(True)  # weights that decay towards zero otherwise slow a CPU down many times
    try:
        with torch_threads(config.threads):
            results = _train(config)
    finally:
        torch.set_flush_denormal(False)  # it holds for all arithmetic of the process, the caller's too
    write_json(output / "results.json", results)
    return results


def _train(config: TrainConfig) -> dict[str, Any]:
    device = _device(config.device)
    data = data_version(config.dataset.path)
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
            raise DatasetError(f"{config.dataset.path}: {len(dataset)} clouds leave none for {name}")
    prepared = prepare(
        dataset,
        config.preprocess,
        removed=config.dataset.removed,
        seed=config.seed,
        cache=config.cache,
        progress=config.progress,
    )
    training, selection, test = (prepared.subset(part).to(device) for part in parts)
    run = _Run(config, dataset.classes, data, device)
    run.fit(training, selection)
    counts = {name: len(part) for name, part in zip(("train", "selection", "test"), parts, strict=True)}
    return {**run.results(training, selection, test), "n_samples": counts}


def log_class_shares(labels: torch.Tensor, n_classes: int) -> torch.Tensor:
    """(n_classes,) logarithms of each class's share of `labels` (n,) int64; an absent class counts as half a label."""
    return (labels.bincount(minlength=n_classes).clamp_min(0.5) / len(labels)).log()


class _Run:
    """Model, optimizer and progress of one run, kept in step with OUTPUT/last."""

    def __init__(self, config: TrainConfig, classes: list[str], data: str, device: torch.device) -> None:
        self.config, self.classes, self.data, self.device = config, classes, data, device
        self.output = Path(config.output)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.model = build_model(config.model.name, config.preprocess.n_points, len(classes))
        self.model.to(device)
        self.optimizer: torch.optim.Optimizer | None = None
        if not isinstance(self.model, NearestNeighbours):  # which has nothing to descend
            self.optimizer = torch.optim.AdamW(
                self.model.parameters(), lr=config.protocol.learning_rate, weight_decay=config.protocol.weight_decay
            )
        self.n_epochs = config.protocol.epochs if self.optimizer else 1
        self.epoch = 0
        self.seconds = 0.0
        self.best = {"epoch": 0, "accuracy": -1.0, "loss": math.inf}
        self.history: dict[str, list[float]] = {name: [] for name in _CURVES}
        self._resume()

    def fit(self, training: PreparedClouds, selection: PreparedClouds) -> None:
        """Train up to the configured epoch, saving after each."""
        config, protocol = self.config, self.config.protocol
        static = None
        if config.augment.is_identity and config.preprocess.n_views == 1:
            static = config.preprocess.arrange(training.candidates, training.valid)
        batch_size = min(protocol.batch_size or len(training), len(training))
        n_steps = math.ceil(len(training) / batch_size)
        if self.epoch == 0 and self.optimizer and protocol.initial_weights == "scaled":
            generator = torch.Generator().manual_seed(config.seed)
            index = torch.randperm(len(training), generator=generator)[:_SCALING_CLOUDS].to(self.device)
            scale_initial_weights(self.model, self._draw(training, index, generator), config.seed)
        inputs = arrange_views(config.preprocess, selection.candidates, selection.valid)
        with Tracker(self.output / "tensorboard", self.epoch) as tracker:
            bar = tqdm(
                range(self.epoch, self.n_epochs),
                desc="training",
                unit="epoch",
                initial=self.epoch,
                total=self.n_epochs,
                disable=not config.progress,
            )
            for epoch in bar:
                begin = time.perf_counter()
                if self.optimizer is None:
                    loss, accuracy, rate = self._keep(training)
                else:
                    loss, accuracy, rate = self._epoch(epoch, training, static, batch_size, n_steps)
                scores = score(log_probabilities(self.model, inputs), selection.labels)
                # Of equally accurate epochs the surer one.
                if (scores.accuracy, -scores.loss) > (self.best["accuracy"], -self.best["loss"]):
                    self.best = {"epoch": epoch + 1, "accuracy": scores.accuracy, "loss": scores.loss}
                    write_checkpoint(self.output / "best", self._checkpoint(epoch + 1))
                for name, value in zip(_CURVES, (loss, accuracy, scores.loss, scores.accuracy, rate), strict=True):
                    self.history[name].append(value)
                self.epoch = epoch + 1
                self.seconds += time.perf_counter() - begin
                self._save()
                tracker.epoch(epoch + 1, loss, accuracy, scores, rate, self.classes)
                bar.set_postfix(loss=f"{loss:.3f}", train=f"{accuracy:.3f}", selection=f"{scores.accuracy:.3f}")

    def results(self, training: PreparedClouds, selection: PreparedClouds, test: PreparedClouds) -> dict[str, Any]:
        """What the run was, and what `report` says of its checkpoints: only here is the test split read."""
        honest = self.config.protocol.selection == "validation"
        return {
            "protocol": "honest: epoch chosen on validation, test read once"
            if honest
            else "published: best epoch on the evaluation split itself, an optimistic figure",
            "classes": self.classes,
            "parameters": sum(parameter.numel() for parameter in self.model.parameters()),
            "epochs": self.epoch,
            "seed": self.config.seed,
            "training_s": round(self.seconds, 2),
            "device": str(self.device),
            "threads": self.config.threads,
            "checkpoint": str(self.output / "best"),
            "config": self.config.decisive(),
            "data": self.data,
            **report(self.output, self.config, training, selection, test),
            "curves": self.history,
        }

    def _epoch(
        self,
        epoch: int,
        training: PreparedClouds,
        static: torch.Tensor | None,
        batch_size: int,
        n_steps: int,
    ) -> tuple[float, float, float]:
        """One pass; mean loss, accuracy in training, last learning rate."""
        config, protocol = self.config, self.config.protocol
        generator = torch.Generator().manual_seed(config.seed * 1_000_003 + epoch)
        # A full batch is not shuffled (as published): its order changes nothing but rounding.
        order = torch.arange(len(training))
        if n_steps > 1:
            order = torch.randperm(len(training), generator=generator)
        offsets = protocol.logit_adjustment * log_class_shares(training.labels, len(self.classes))
        self.model.train()
        assert self.optimizer is not None
        loss_sum, correct, rate = 0.0, 0, protocol.learning_rate
        # Dropout draws from torch's own generator: seeded here like the others, and left as it was found.
        with torch.random.fork_rng(devices=[self.device] if self.device.type == "cuda" else []):
            torch.manual_seed(config.seed * 1_000_003 + epoch)
            for step, index in enumerate(order.to(self.device).split(batch_size)):
                if len(index) == 1:
                    continue  # batch norm has no variance of one
                rate = self._learning_rate((epoch * n_steps + step) / (protocol.epochs * n_steps))
                for group in self.optimizer.param_groups:
                    group["lr"] = rate
                labels = training.labels[index]
                inputs = static[index] if static is not None else self._draw(training, index, generator)
                with torch.autocast(self.device.type, torch.bfloat16, enabled=protocol.precision == "bfloat16"):
                    logits = self.model(inputs)
                logits = logits.float()
                loss = nn.functional.cross_entropy(logits + offsets, labels, label_smoothing=protocol.label_smoothing)
                if isinstance(self.model, PointNet):
                    assert self.model.penalty is not None
                    loss = loss + self.model.penalty
                value = loss.item()
                if not math.isfinite(value):
                    raise TrainingError(f"the loss is {value} in epoch {epoch + 1}: learning rate {rate:g} is too high")
                self.optimizer.zero_grad(set_to_none=True)
                loss.backward()
                self.optimizer.step()
                loss_sum += value * len(index)
                correct += int((logits.detach().argmax(dim=1) == labels).sum())
        return loss_sum / len(training), correct / len(training), rate

    def _keep(self, training: PreparedClouds) -> tuple[float, float, float]:
        """The epoch of k-nearest-neighbour: the clouds as they are; loss and accuracy by leave-one-out."""
        assert isinstance(self.model, NearestNeighbours)
        inputs = self.config.preprocess.arrange(training.candidates, training.valid)
        scores = score(self.model.fit(inputs, training.labels), training.labels)
        return scores.loss, scores.accuracy, 0.0

    def _draw(self, training: PreparedClouds, index: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        points, valid = augment(training.candidates[index], training.valid[index], self.config.augment, generator)
        view = torch.randint(self.config.preprocess.n_views, (len(index),), generator=generator).to(self.device)
        return self.config.preprocess.arrange(points, valid, view)

    def _learning_rate(self, progress: float) -> float:
        """The rate at `progress` in [0, 1): constant, or a tenth of the run up and a cosine down to nothing."""
        peak = self.config.protocol.learning_rate
        if self.config.protocol.schedule == "constant":
            return peak
        if progress < 0.1:
            return peak * (0.05 + 0.95 * progress / 0.1)
        return peak * (0.5 + 0.5 * math.cos(math.pi * (progress - 0.1) / 0.9))

    def _checkpoint(self, epoch: int) -> Checkpoint:
        config = self.config
        return Checkpoint(self.model, self.classes, config.preprocess, 1.0, epoch, config.model.name)

    def _save(self) -> None:
        moments: dict[str, torch.Tensor] = {}
        names = {id(parameter): name for name, parameter in self.model.named_parameters()}
        for parameter, state in self.optimizer.state.items() if self.optimizer else ():
            for key, value in state.items():
                moments[f"{names[id(parameter)]}/{key}"] = value.detach().cpu().contiguous()
        progress = {
            "epoch": self.epoch,
            "seconds": self.seconds,
            "best": self.best,
            "history": self.history,
            "classes": self.classes,
            "config": self.config.decisive(),
            "data": self.data,
        }
        write_checkpoint(self.output / "last", self._checkpoint(self.epoch), TrainingState(moments, progress))

    def _resume(self) -> None:
        state = read_training_state(self.output / "last")
        if state is None:
            return
        check_same(self.config, self.data, state.progress)
        if state.progress["classes"] != self.classes:
            raise ConfigError(f"output {self.output} holds a run with classes {state.progress['classes']}")
        self.model.load_state_dict(read_checkpoint(self.output / "last").model.state_dict())
        for name, parameter in self.model.named_parameters() if self.optimizer else ():
            assert self.optimizer is not None
            self.optimizer.state[parameter] = {
                key: state.optimizer[f"{name}/{key}"].to(parameter.device if key != "step" else "cpu")
                for key in ("step", "exp_avg", "exp_avg_sq")
            }
        self.epoch, self.seconds = state.progress["epoch"], state.progress["seconds"]
        self.best, self.history = state.progress["best"], state.progress["history"]


def _device(name: str) -> torch.device:
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device=cuda, but torch finds no CUDA device")
    return torch.device("cuda" if name == "auto" and torch.cuda.is_available() else name.replace("auto", "cpu"))
