"""A checkpoint of a network that judges or proposes grasps: documented files, replaced as a whole; none is a pickle.

config.json           the network's settings, the gripper's measures among them, the epoch, versions
model.safetensors     weights and batch-norm statistics
training_state/       optimizer.safetensors and progress.json, only where training goes on from here
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass

from pec.checkpoint import TrainingState
from pec.common.atomic_files import current_directory, replacing_directory
from pec.common.checkpoint_files import package_versions, read_config, read_tensors, write_parts
from pec.common.settings import settings_as
from pec.errors import CheckpointError, ConfigError
from pec.grasps.network import GraspNetwork, NetworkConfig, build_network

__all__ = ["GraspCheckpoint", "read_grasp_checkpoint", "write_grasp_checkpoint"]

FORMAT = 1
KIND = "grasps"


@dataclass(frozen=True)
class GraspCheckpoint:
    """What is needed to judge or to propose grasps."""

    network: GraspNetwork
    config: NetworkConfig
    epoch: int


def write_grasp_checkpoint(
    directory: str | os.PathLike[str], checkpoint: GraspCheckpoint, state: TrainingState | None = None
) -> None:
    """Write `directory` atomically: a reader finds the old checkpoint or the new one."""
    config = {
        "kind": KIND,
        "format": FORMAT,
        "network": asdict(checkpoint.config),
        "epoch": checkpoint.epoch,
        "versions": package_versions(),
    }
    with replacing_directory(directory) as new:
        write_parts(new, config, checkpoint.network.state_dict(), state)


def read_grasp_checkpoint(directory: str | os.PathLike[str]) -> GraspCheckpoint:
    """Read a checkpoint; the network is on the CPU, in evaluation mode.

    Raises CheckpointError where it is missing, incomplete, of another kind or format, or weights and settings disagree.
    """
    directory = current_directory(directory)
    config = read_config(directory, KIND, FORMAT, "`pecgrasp train-grasps`")
    try:
        settings = settings_as(NetworkConfig, config["network"])
        network = build_network(settings)
        network.load_state_dict(read_tensors(directory / "model.safetensors"))
        epoch = int(config["epoch"])
    except (ConfigError, KeyError, TypeError, AttributeError, RuntimeError) as error:
        raise CheckpointError(f"{directory}: config.json and the weights do not fit: {error}") from error
    return GraspCheckpoint(network.eval(), settings, epoch)
