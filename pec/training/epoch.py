"""One epoch: a pass of gradient descent over the training clouds, every draw of which comes from (seed, epoch)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from copy import deepcopy
from dataclasses import dataclass

import torch
from torch import nn

from pec.data.augment import augment
from pec.data.tensor_dataset import PreparedClouds
from pec.metrics.scores import score
from pec.networks.baselines import Memorising, PointNet
from pec.networks.initialise import scale_initial_weights
from pec.training.config import ProtocolConfig, TrainConfig
from pec.training.running_statistics import without_their_start
from pec.training.schedule import warm_cosine
from pec.training.step import take_step

__all__ = ["EpochResult", "Epochs", "learning_rate", "log_class_shares", "memorise"]

_SCALING_CLOUDS = 512  # that initial weights are scaled to
_TRIAL_CLOUDS = 512  # of a step that is timed: more take longer and show nothing new


@dataclass(frozen=True)
class EpochResult:
    """Mean loss, accuracy in training in [0, 1], last learning rate."""

    loss: float
    accuracy: float
    learning_rate: float


class Epochs:
    """Epochs over the `training` clouds as `config` says."""

    def __init__(self, config: TrainConfig, training: PreparedClouds, n_classes: int) -> None:
        self._config, self._training = config, training
        self._device = training.candidates.device
        self._batch_size = min(config.protocol.batch_size or len(training), len(training))
        self._n_steps = math.ceil(len(training) / self._batch_size)
        self._offsets = config.protocol.logit_adjustment * log_class_shares(training.labels, n_classes)
        self._unchanging = None  # inputs that are the same in every epoch
        if config.augment.is_identity and config.preprocess.n_views == 1:
            self._unchanging = config.preprocess.arrange(training.candidates, training.valid)

    def scale_initial_weights(self, model: nn.Module) -> None:
        """Scale the weights of a fresh `model` to some of the clouds."""
        seed = self._config.seed
        generator = torch.Generator().manual_seed(seed)
        index = torch.randperm(len(self._training), generator=generator)[:_SCALING_CLOUDS].to(self._device)
        scale_initial_weights(model, self._draw(index, generator), seed)

    def trial(self, model: nn.Module) -> Callable[[str], object]:
        """A step of training in the precision that it is given, on a copy of `model`, to be timed."""
        copy = deepcopy(model).train()
        index = torch.arange(min(self._batch_size, _TRIAL_CLOUDS), device=self._device)
        inputs, labels = self._draw(index, torch.Generator().manual_seed(0)), self._training.labels[index]

        def step(precision: str) -> None:
            with self._seeded(0):
                self._loss(copy, inputs, labels, precision)[1].backward()

        return step

    def run(self, model: nn.Module, optimizer: torch.optim.Optimizer, epoch: int, precision: str) -> EpochResult:
        """Train `model` by one pass, the `epoch`-th from 0, with products in `precision`.

        Raises TrainingError where the loss is not finite.
        """
        protocol, seed = self._config.protocol, self._config.seed * 1_000_003 + epoch
        generator = torch.Generator().manual_seed(seed)
        n = len(self._training)
        # A full batch is not shuffled (as published): its order changes nothing but rounding.
        order = torch.arange(n) if self._n_steps == 1 else torch.randperm(n, generator=generator)
        loss_sum, correct, rate = 0.0, 0, protocol.learning_rate
        model.train()
        corrected = protocol.running_statistics == "corrected"
        with self._seeded(seed), without_their_start(model) if corrected else nullcontext():
            # Batches of equal size: what is left over may be two clouds, whose variance says nothing.
            for step, index in enumerate(order.to(self._device).tensor_split(self._n_steps)):
                if len(index) == 1:
                    continue  # batch norm has no variance of one
                rate = learning_rate(protocol, (epoch * self._n_steps + step) / (protocol.epochs * self._n_steps))
                labels = self._training.labels[index]
                inputs = self._unchanging[index] if self._unchanging is not None else self._draw(index, generator)
                logits, loss = self._loss(model, inputs, labels, precision)
                loss_sum += take_step(optimizer, loss, rate, epoch) * len(index)
                correct += int((logits.detach().argmax(dim=1) == labels).sum())
        return EpochResult(loss_sum / n, correct / n, rate)

    @contextmanager
    def _seeded(self, seed: int) -> Iterator[None]:
        """Dropout draws from torch's own generator: seeded here like the others, and left as it was found."""
        with torch.random.fork_rng(devices=[self._device] if self._device.type == "cuda" else []):
            torch.manual_seed(seed)
            yield

    def _loss(
        self, model: nn.Module, inputs: torch.Tensor, labels: torch.Tensor, precision: str
    ) -> tuple[torch.Tensor, torch.Tensor]:
        protocol = self._config.protocol
        with torch.autocast(self._device.type, torch.bfloat16, enabled=precision == "bfloat16"):
            logits = model(inputs)
        logits = logits.float()
        loss = nn.functional.cross_entropy(logits + self._offsets, labels, label_smoothing=protocol.label_smoothing)
        if isinstance(model, PointNet):
            assert model.penalty is not None
            loss = loss + model.penalty
        return logits, loss

    def _draw(self, index: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """Inputs of the clouds `index`, augmented, each in one of its equally valid poses."""
        training, preprocess = self._training, self._config.preprocess
        points, valid = augment(training.candidates[index], training.valid[index], self._config.augment, generator)
        view = torch.randint(preprocess.n_views, (len(index),), generator=generator).to(self._device)
        return preprocess.arrange(points, valid, view)


def memorise(model: Memorising, config: TrainConfig, training: PreparedClouds) -> EpochResult:
    """The one epoch of what has no gradient: the clouds as they are; loss and accuracy of each by the others."""
    inputs = config.preprocess.arrange(training.candidates, training.valid)
    scores = score(model.fit(inputs, training.labels), training.labels)
    return EpochResult(scores.loss, scores.accuracy, 0.0)


def learning_rate(protocol: ProtocolConfig, progress: float) -> float:
    """The rate at `progress` in [0, 1): constant, or a tenth of the run up and a cosine down to nothing."""
    peak = protocol.learning_rate
    if protocol.schedule == "constant":
        return peak
    return warm_cosine(peak, progress)


def log_class_shares(labels: torch.Tensor, n_classes: int) -> torch.Tensor:
    """(n_classes,) logarithms of each class's share of `labels` (n,) int64; an absent class counts as half a label."""
    return (labels.bincount(minlength=n_classes).clamp_min(0.5) / len(labels)).log()
