"""What a run of pose training has come to, kept in OUTPUT/last after each epoch, and resumed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import torch

from pec.checkpoint import TrainingState, read_training_state
from pec.common.optimizer_state import adam_moments, adamw, restore_adam_moments
from pec.common.run_identity import check_same_run
from pec.pose.checkpoint import PoseCheckpoint, read_pose_checkpoint, write_pose_checkpoint
from pec.pose.config import PoseTrainConfig
from pec.pose.models import PoseModels
from pec.pose.network import PoseNetwork

__all__ = ["OTHER_DATA", "PoseRunState"]

OTHER_DATA = "other clouds or models"
"""How an error calls data that are not those of the run in the output folder."""

CURVES = ("train_loss", "validation_likeliest", "validation_nearest", "learning_rate")


class PoseRunState:
    """The state after `epoch` epochs of the run in config.output: where it is new 0, otherwise those that were saved.

    best: of the epoch whose checkpoint is OUTPUT/best: "epoch", "likeliest" (mean distance of the likeliest proposal on
    the validation clouds, in radii of the model). history: a value an epoch of each curve.
    Raises ConfigError where the folder holds another run, CheckpointError where what it holds is broken.
    """

    def __init__(self, config: PoseTrainConfig, models: PoseModels, data: str, device: torch.device) -> None:
        self._config, self._models, self._data = config, models, data
        self._output = Path(config.output)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.network = PoseNetwork(config.network, len(models.names))
        self.network.to(device)
        protocol = config.protocol
        self.optimizer = adamw(self.network, protocol.learning_rate, protocol.weight_decay, device)
        self.epoch, self.seconds = 0, 0.0
        self.best: dict[str, float] = {"epoch": 0, "likeliest": math.inf}
        self.history: dict[str, list[float]] = {name: [] for name in CURVES}
        self._resume()

    def finish_epoch(self, loss: float, validation: Mapping[str, float], rate: float, seconds: float) -> None:
        """Count one more epoch; save OUTPUT/best where it is the best yet, and OUTPUT/last."""
        self.epoch += 1
        self.seconds += seconds
        checkpoint = PoseCheckpoint(self.network, self._models, self.epoch)
        if validation["likeliest"] < self.best["likeliest"]:
            self.best = {"epoch": self.epoch, "likeliest": validation["likeliest"]}
            write_pose_checkpoint(self._output / "best", checkpoint)
        for name, value in zip(CURVES, (loss, validation["likeliest"], validation["nearest"], rate), strict=True):
            self.history[name].append(value)
        moments = adam_moments(self.network, self.optimizer)
        progress = {
            "epoch": self.epoch,
            "seconds": self.seconds,
            "best": self.best,
            "history": self.history,
            "config": self._config.decisive(),
            "data": self._data,
        }
        write_pose_checkpoint(self._output / "last", checkpoint, TrainingState(moments, progress))

    def _resume(self) -> None:
        state = read_training_state(self._output / "last")
        if state is None:
            return
        check_same_run(self._config.output, self._config.decisive(), self._data, state.progress, OTHER_DATA)
        self.network.load_state_dict(read_pose_checkpoint(self._output / "last").network.state_dict())
        restore_adam_moments(self.network, self.optimizer, state.optimizer)
        self.epoch, self.seconds = state.progress["epoch"], state.progress["seconds"]
        self.best, self.history = state.progress["best"], state.progress["history"]
