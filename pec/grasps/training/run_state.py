"""What a training run on grasp labels is, and what it has come to."""

from __future__ import annotations

from pathlib import Path

import torch

from pec.checkpoint import TrainingState
from pec.grasps.checkpoint import GraspCheckpoint, read_grasp_checkpoint, write_grasp_checkpoint
from pec.grasps.network import GraspNetwork, build_network
from pec.grasps.training.config import GraspTrainConfig
from pec.training.epoch_state import EpochState, NetworkFiles, TrainingRun

__all__ = ["grasp_run", "grasp_state"]

CURVES = ("train_loss", "validation_loss", "learning_rate")


def grasp_run(config: GraspTrainConfig, data: str) -> TrainingRun:
    """The run of these settings on labels of this hash."""
    return TrainingRun(config.output, config.decisive(), data, "other labels")


def grasp_state(config: GraspTrainConfig, run: TrainingRun, device: torch.device) -> EpochState[GraspNetwork]:
    """Judged by the loss on the validation instances."""

    def write(directory: Path, network: GraspNetwork, epoch: int, state: TrainingState | None) -> None:
        write_grasp_checkpoint(directory, GraspCheckpoint(network, config.network, epoch), state)

    protocol = config.protocol
    return EpochState(
        run,
        lambda: build_network(config.network),
        NetworkFiles(write, lambda directory: read_grasp_checkpoint(directory).network),
        seed=config.seed,
        learning_rate=protocol.learning_rate,
        weight_decay=protocol.weight_decay,
        device=device,
        curves=CURVES,
        judged_by="loss",
        least_is_best=True,
    )
