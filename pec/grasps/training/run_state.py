"""What a training run has come to, kept in OUTPUT/last after each epoch, and resumed."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from pec.checkpoint import TrainingState, read_training_state
from pec.common.optimizer_state import adam_moments, adamw, restore_adam_moments
from pec.common.run_identity import check_same_run
from pec.grasps.checkpoint import GraspCheckpoint, read_grasp_checkpoint, write_grasp_checkpoint
from pec.grasps.network import build_network
from pec.grasps.training.config import GraspTrainConfig

__all__ = ["OTHER_DATA", "GraspRunState"]

OTHER_DATA = "other labels"
"""How an error calls data that are not those of the run in the output folder."""

CURVES = ("train_loss", "validation_loss", "learning_rate")


class GraspRunState:
    """The state after `epoch` epochs of the run in config.output: where it is new 0, otherwise those that were saved.

    best: of the epoch whose checkpoint is OUTPUT/best: "epoch", "loss" (on the validation instances). history: a value
    an epoch of each curve.
    Raises ConfigError where the folder holds another run, CheckpointError where what it holds is broken.
    """

    def __init__(self, config: GraspTrainConfig, data: str, device: torch.device) -> None:
        self._config, self._data = config, data
        self._output = Path(config.output)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.network = build_network(config.network).to(device)
        protocol = config.protocol
        self.optimizer = adamw(self.network, protocol.learning_rate, protocol.weight_decay, device)
        self.epoch, self.seconds = 0, 0.0
        self.best: dict[str, float] = {"epoch": 0, "loss": math.inf}
        self.history: dict[str, list[float]] = {name: [] for name in CURVES}
        self._resume()

    def finish_epoch(self, train_loss: float, validation_loss: float, rate: float, seconds: float) -> None:
        """Count one more epoch; save OUTPUT/best where it is the best yet, and OUTPUT/last."""
        self.epoch += 1
        self.seconds += seconds
        checkpoint = GraspCheckpoint(self.network, self._config.network, self.epoch)
        if validation_loss < self.best["loss"]:
            self.best = {"epoch": self.epoch, "loss": validation_loss}
            write_grasp_checkpoint(self._output / "best", checkpoint)
        for name, value in zip(CURVES, (train_loss, validation_loss, rate), strict=True):
            self.history[name].append(value)
        progress = {
            "epoch": self.epoch,
            "seconds": self.seconds,
            "best": self.best,
            "history": self.history,
            "config": self._config.decisive(),
            "data": self._data,
        }
        moments = adam_moments(self.network, self.optimizer)
        write_grasp_checkpoint(self._output / "last", checkpoint, TrainingState(moments, progress))

    def _resume(self) -> None:
        state = read_training_state(self._output / "last")
        if state is None:
            return
        check_same_run(self._config.output, self._config.decisive(), self._data, state.progress, OTHER_DATA)
        self.network.load_state_dict(read_grasp_checkpoint(self._output / "last").network.state_dict())
        restore_adam_moments(self.network, self.optimizer, state.optimizer)
        progress = state.progress
        self.epoch, self.seconds, self.best = progress["epoch"], progress["seconds"], progress["best"]
        self.history = progress["history"]
