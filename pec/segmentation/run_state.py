"""What a training run of a network that labels points is, and what it has come to."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import nn

from pec.checkpoint import TrainingState
from pec.networks.segmentation import SEGMENTATION
from pec.segmentation.checkpoint import PointCheckpoint, read_point_checkpoint, write_point_checkpoint
from pec.segmentation.config import PointTrainConfig
from pec.training.epoch_state import EpochState, NetworkFiles, TrainingRun
from pec.training.precision import Precision

__all__ = ["point_run", "point_state"]

CURVES = ("loss_train", "accuracy_validation", "mean_iou_validation", "learning_rate")


def point_run(config: PointTrainConfig, data: str) -> TrainingRun:
    """The run of these settings on clouds of this hash."""
    return TrainingRun(config.output, config.decisive(), data, "other clouds")


def point_state(
    config: PointTrainConfig, run: TrainingRun, classes: list[str], device: torch.device
) -> EpochState[nn.Module]:
    """Judged by the mean IoU on the validation clouds."""

    def write(directory: Path, network: nn.Module, epoch: int, state: TrainingState | None) -> None:
        checkpoint = PointCheckpoint(network, config.network, config.n_points, classes, epoch)
        write_point_checkpoint(directory, checkpoint, state)

    protocol, asked = config.protocol, config.protocol.precision
    return EpochState(
        run,
        lambda: SEGMENTATION[config.network](config.n_points, len(classes)),
        NetworkFiles(write, lambda directory: read_point_checkpoint(directory).network),
        seed=config.seed,
        learning_rate=protocol.learning_rate,
        weight_decay=protocol.weight_decay,
        device=device,
        curves=CURVES,
        judged_by="mean_iou",
        least_is_best=False,
        precision=None if asked == "auto" else Precision(asked, asked),
    )
