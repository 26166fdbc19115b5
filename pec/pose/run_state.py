"""What a run of pose training is, and what it has come to."""

from __future__ import annotations

from pathlib import Path

import torch

from pec.checkpoint import TrainingState
from pec.pose.checkpoint import PoseCheckpoint, read_pose_checkpoint, write_pose_checkpoint
from pec.pose.config import PoseTrainConfig
from pec.pose.models import PoseModels
from pec.pose.network import PoseNetwork
from pec.training.epoch_state import EpochState, NetworkFiles, TrainingRun

__all__ = ["pose_run", "pose_state"]

CURVES = ("train_loss", "validation_likeliest", "validation_nearest", "learning_rate")


def pose_run(config: PoseTrainConfig, data: str) -> TrainingRun:
    """The run of these settings on clouds and models of this hash."""
    return TrainingRun(config.output, config.decisive(), data, "other clouds or models")


def pose_state(
    config: PoseTrainConfig, run: TrainingRun, models: PoseModels, device: torch.device
) -> EpochState[PoseNetwork]:
    """Judged by the mean distance of the likeliest proposal on the validation clouds, in radii of the model."""

    def write(directory: Path, network: PoseNetwork, epoch: int, state: TrainingState | None) -> None:
        write_pose_checkpoint(directory, PoseCheckpoint(network, models, epoch), state)

    protocol = config.protocol
    return EpochState(
        run,
        lambda: PoseNetwork(config.network, len(models.names)),
        NetworkFiles(write, lambda directory: read_pose_checkpoint(directory).network),
        seed=config.seed,
        learning_rate=protocol.learning_rate,
        weight_decay=protocol.weight_decay,
        device=device,
        curves=CURVES,
        judged_by="likeliest",
        least_is_best=True,
    )
