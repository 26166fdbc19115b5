"""What a run of training has come to, kept in OUTPUT/last after each epoch, and resumed."""

from __future__ import annotations

from pathlib import Path

import torch

from pec.checkpoint import TrainingState, read_training_state
from pec.common.optimizer_state import adam_moments, adamw, restore_adam_moments
from pec.common.run_identity import check_same_run
from pec.networks.segmentation import SEGMENTATION
from pec.segmentation.checkpoint import PointCheckpoint, read_point_checkpoint, write_point_checkpoint
from pec.segmentation.config import PointTrainConfig
from pec.segmentation.scores import PointScores
from pec.training.precision import Precision

__all__ = ["OTHER_DATA", "PointRunState"]

OTHER_DATA = "other clouds"
"""How an error calls data that are not those of the run in the output folder."""

CURVES = ("loss_train", "accuracy_validation", "mean_iou_validation", "learning_rate")


class PointRunState:
    """The state after `epoch` epochs of the run in config.output: where it is new 0, otherwise those that were saved.

    best: of the epoch whose checkpoint is OUTPUT/best: "epoch", "mean_iou" on the validation clouds. history: a value
    an epoch of each curve. precision: what the first epoch was made in; None where that is still to be chosen.
    Raises ConfigError where the folder holds another run, CheckpointError where what it holds is broken.
    """

    def __init__(self, config: PointTrainConfig, classes: list[str], data: str, device: torch.device) -> None:
        self._config, self._classes, self._data = config, classes, data
        self._output = Path(config.output)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            self.network = SEGMENTATION[config.network](config.n_points, len(classes))
        self.network.to(device)
        protocol = config.protocol
        self.optimizer = adamw(self.network, protocol.learning_rate, protocol.weight_decay, device)
        self.epoch, self.seconds = 0, 0.0
        self.best: dict[str, float] = {"epoch": 0, "mean_iou": -1.0}
        self.history: dict[str, list[float]] = {name: [] for name in CURVES}
        asked = protocol.precision
        self.precision = None if asked == "auto" else Precision(asked, asked)
        self._resume()

    def finish_epoch(self, loss: float, validation: PointScores, rate: float, seconds: float) -> None:
        """Count one more epoch; save OUTPUT/best where it is the best yet, and OUTPUT/last."""
        assert self.precision is not None
        self.epoch += 1
        self.seconds += seconds
        config = self._config
        checkpoint = PointCheckpoint(self.network, config.network, config.n_points, self._classes, self.epoch)
        if validation.mean_iou > self.best["mean_iou"]:
            self.best = {"epoch": self.epoch, "mean_iou": validation.mean_iou}
            write_point_checkpoint(self._output / "best", checkpoint)
        for name, value in zip(CURVES, (loss, validation.accuracy, validation.mean_iou, rate), strict=True):
            self.history[name].append(value)
        progress = {
            "epoch": self.epoch,
            "seconds": self.seconds,
            "best": self.best,
            "history": self.history,
            "precision": self.precision.as_dict(),
            "config": config.decisive(),
            "data": self._data,
        }
        state = TrainingState(adam_moments(self.network, self.optimizer), progress)
        write_point_checkpoint(self._output / "last", checkpoint, state)

    def _resume(self) -> None:
        state = read_training_state(self._output / "last")
        if state is None:
            return
        check_same_run(self._config.output, self._config.decisive(), self._data, state.progress, OTHER_DATA)
        self.network.load_state_dict(read_point_checkpoint(self._output / "last").network.state_dict())
        restore_adam_moments(self.network, self.optimizer, state.optimizer)
        self.epoch, self.seconds = state.progress["epoch"], state.progress["seconds"]
        self.best, self.history = state.progress["best"], state.progress["history"]
        self.precision = Precision(**state.progress["precision"])
