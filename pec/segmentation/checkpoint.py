"""The checkpoint of a network that gives every point a class: a directory, replaced as a whole; nothing is a pickle.

config.json           the network's name, points, classes, epoch, versions
model.safetensors     weights and batch-norm statistics
training_state/       optimizer.safetensors and progress.json, only where training goes on from here
"""

from __future__ import annotations

import os
from dataclasses import dataclass

from torch import nn

from pec.checkpoint import TrainingState
from pec.common.atomic_files import current_directory, replacing_directory
from pec.common.checkpoint_files import package_versions, read_config, read_tensors, write_parts
from pec.errors import CheckpointError, ConfigError
from pec.networks.segmentation import SEGMENTATION

__all__ = ["PointCheckpoint", "read_point_checkpoint", "write_point_checkpoint"]

FORMAT = 1
KIND = "point segmentation"


@dataclass(frozen=True)
class PointCheckpoint:
    """What is needed to label points. name: of `pec.networks.segmentation`. classes: the last is none of the others."""

    network: nn.Module
    name: str
    n_points: int
    classes: list[str]
    epoch: int


def write_point_checkpoint(
    directory: str | os.PathLike[str], checkpoint: PointCheckpoint, state: TrainingState | None = None
) -> None:
    """Write `directory` atomically: a reader finds the old checkpoint or the new one."""
    config = {
        "kind": KIND,
        "format": FORMAT,
        "network": checkpoint.name,
        "n_points": checkpoint.n_points,
        "classes": checkpoint.classes,
        "epoch": checkpoint.epoch,
        "versions": package_versions(),
    }
    with replacing_directory(directory) as new:
        write_parts(new, config, checkpoint.network.state_dict(), state)


def read_point_checkpoint(directory: str | os.PathLike[str]) -> PointCheckpoint:
    """Read a checkpoint; the network is on the CPU, in evaluation mode.

    Raises CheckpointError where it is missing, incomplete, of another kind or format, or its parts disagree.
    """
    directory = current_directory(directory)
    config = read_config(directory, KIND, FORMAT, "point segmentation")
    try:
        name, n_points, classes = str(config["network"]), int(config["n_points"]), [str(c) for c in config["classes"]]
        network = SEGMENTATION[name](n_points, len(classes))
        network.load_state_dict(read_tensors(directory / "model.safetensors"))
        return PointCheckpoint(network.eval(), name, n_points, classes, int(config["epoch"]))
    except (ConfigError, KeyError, TypeError, ValueError, RuntimeError) as error:
        raise CheckpointError(f"{directory}: its parts disagree or are of another version: {error}") from error
