"""A pose network's checkpoint: a directory of documented files, replaced as a whole; nothing in it is a pickle.

config.json           the network's settings, the epoch, versions
model.safetensors     weights and batch-norm statistics
models.safetensors    the models whose poses it gives (`pec.pose.models`)
training_state/       optimizer.safetensors and progress.json, only where training goes on from here
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from typing import Any

from pec.checkpoint import TrainingState
from pec.common.atomic_files import current_directory, replacing_directory
from pec.common.checkpoint_files import package_versions, read_config, read_tensors, write_parts
from pec.common.settings import settings_as
from pec.errors import CheckpointError, ConfigError, ModelsError
from pec.pose.models import PoseModels, read_models, write_models
from pec.pose.network import NetworkConfig, PoseNetwork

__all__ = ["PoseCheckpoint", "read_pose_checkpoint", "write_pose_checkpoint"]

FORMAT = 1
KIND = "pose"


@dataclass(frozen=True)
class PoseCheckpoint:
    """What is needed to propose poses."""

    network: PoseNetwork
    models: PoseModels
    epoch: int


def write_pose_checkpoint(
    directory: str | os.PathLike[str], checkpoint: PoseCheckpoint, state: TrainingState | None = None
) -> None:
    """Write `directory` atomically: a reader finds the old checkpoint or the new one."""
    config: dict[str, Any] = {
        "kind": KIND,
        "format": FORMAT,
        "network": asdict(checkpoint.network.config),
        "models": list(checkpoint.models.names),
        "epoch": checkpoint.epoch,
        "versions": package_versions(),
    }
    with replacing_directory(directory) as new:
        write_parts(new, config, checkpoint.network.state_dict(), state)
        write_models(new / "models.safetensors", checkpoint.models)


def read_pose_checkpoint(directory: str | os.PathLike[str]) -> PoseCheckpoint:
    """Read a checkpoint; the network is on the CPU, in evaluation mode.

    Raises CheckpointError where it is missing, incomplete, of another kind or format, or its parts disagree.
    """
    directory = current_directory(directory)
    config = read_config(directory, KIND, FORMAT, "a pose network")
    try:
        models = read_models(directory / "models.safetensors")
        network = PoseNetwork(settings_as(NetworkConfig, config["network"]), len(models.names))
        epoch = int(config["epoch"])
    except (ModelsError, ConfigError, KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(f"{directory} is not a pose network's checkpoint: {error}") from error
    try:
        network.load_state_dict(read_tensors(directory / "model.safetensors"))
    except RuntimeError as error:
        raise CheckpointError(f"{directory}: the weights do not fit its settings and models: {error}") from error
    return PoseCheckpoint(network.eval(), models, epoch)
