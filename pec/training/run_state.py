"""What a run has come to: model, optimizer and progress, kept in OUTPUT/last after each epoch, and resumed."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from pec.checkpoint import Checkpoint, TrainingState, read_checkpoint, read_training_state, write_checkpoint
from pec.common.optimizer_state import adam_moments, adamw, restore_adam_moments
from pec.data.dataset import UNKNOWN
from pec.errors import ConfigError
from pec.metrics.scores import Scores
from pec.networks.baselines import Memorising
from pec.networks.registry import build_model
from pec.training.config import TrainConfig
from pec.training.epoch import EpochResult
from pec.training.finished_runs import check_same
from pec.training.precision import Precision

__all__ = ["RunState"]

_CURVES = ("train_loss", "train_accuracy", "selection_loss", "selection_accuracy", "learning_rate")


class RunState:
    """The state after `epoch` epochs of the run in config.output: where it is new 0, otherwise those that were saved.

    optimizer: None for k-nearest-neighbour, which has nothing to descend. best: of the epoch whose checkpoint is
    OUTPUT/best: "epoch", "accuracy" (on the selection split, strangers one more class), "loss". history: a value an
    epoch of each curve. precision: what the first epoch was made in, and so is the rest; None where that is still to be
    chosen.

    Raises ConfigError where the folder holds another run, CheckpointError where what it holds is broken.
    """

    def __init__(self, config: TrainConfig, classes: list[str], data: str, device: torch.device) -> None:
        self._config, self._data = config, data
        self._output = Path(config.output)
        self.classes = classes
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.model = build_model(config.model.name, config.preprocess.n_points, len(classes))
        self.model.to(device)
        self.optimizer: torch.optim.Optimizer | None = None
        if not isinstance(self.model, Memorising):
            protocol = config.protocol
            self.optimizer = adamw(self.model, protocol.learning_rate, protocol.weight_decay, device)
        self.epoch = 0
        self.seconds = 0.0
        self.best = {"epoch": 0, "accuracy": -1.0, "loss": math.inf}
        self.history: dict[str, list[float]] = {name: [] for name in _CURVES}
        asked = config.protocol.precision
        self.precision = None if asked == "auto" else Precision(asked, asked)
        self._resume()

    @property
    def n_epochs(self) -> int:
        """Epochs that the run is to have in the end."""
        return self._config.protocol.epochs if self.optimizer else 1

    def finish_epoch(self, trained: EpochResult, selection: Scores, seconds: float) -> None:
        """Count one more epoch; save OUTPUT/best where it is the best yet on the selection split, and OUTPUT/last."""
        self.epoch += 1
        self.seconds += seconds
        # Of equally accurate epochs the surer one; strangers are to be answered, too.
        if (selection.answered, -selection.loss) > (self.best["accuracy"], -self.best["loss"]):
            self.best = {"epoch": self.epoch, "accuracy": selection.answered, "loss": selection.loss}
            write_checkpoint(self._output / "best", self._checkpoint())
        values = (trained.loss, trained.accuracy, selection.loss, selection.accuracy, trained.learning_rate)
        for name, value in zip(_CURVES, values, strict=True):
            self.history[name].append(value)
        self._save()

    def _checkpoint(self) -> Checkpoint:
        config = self._config
        known = [name for name in self.classes if name != UNKNOWN]
        refuses = UNKNOWN in self.classes
        return Checkpoint(
            self.model, known, config.preprocess, 1.0, self.epoch, config.model.name, none_of_these=refuses
        )

    def _save(self) -> None:
        assert self.precision is not None
        moments = adam_moments(self.model, self.optimizer) if self.optimizer else {}
        progress = {
            "epoch": self.epoch,
            "seconds": self.seconds,
            "best": self.best,
            "history": self.history,
            "precision": self.precision.as_dict(),
            "classes": self.classes,
            "config": self._config.decisive(),
            "data": self._data,
        }
        write_checkpoint(self._output / "last", self._checkpoint(), TrainingState(moments, progress))

    def _resume(self) -> None:
        state = read_training_state(self._output / "last")
        if state is None:
            return
        check_same(self._config, self._data, state.progress)
        if state.progress["classes"] != self.classes:
            raise ConfigError(f"output {self._output} holds a run with classes {state.progress['classes']}")
        self.model.load_state_dict(read_checkpoint(self._output / "last").model.state_dict())
        if self.optimizer is not None:
            restore_adam_moments(self.model, self.optimizer, state.optimizer)
        self.epoch, self.seconds = state.progress["epoch"], state.progress["seconds"]
        self.best, self.history = state.progress["best"], state.progress["history"]
        self.precision = Precision(**state.progress["precision"])
