"""A checkpoint is a directory of documented files, replaced as a whole; nothing in it is a pickle.

config.json               network, classes, preprocessing, temperature, threshold of the unknown, versions, epoch
model.safetensors         weights and batch-norm statistics
knowing.safetensors       what tells the known from strangers (`pec.known.knowing.Knowing`); older checkpoints have none
forms.safetensors         the witness of forms (`pec.known.form_witness.FormWitness`), where there is one
enrolled.safetensors      clouds of classes that were shown later, as descriptors, where there are such
training_state/           only where training goes on from here
    optimizer.safetensors     Adam's moments, one tensor a parameter
    progress.json             epoch, history, best so far, the configuration. Random draws are seeded by (seed, epoch),
                              so there is no generator state to keep.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, field
from pathlib import Path

from safetensors import SafetensorError
from safetensors.numpy import load_file as load_arrays
from safetensors.numpy import save_file as save_arrays
from torch import nn

from pec.common.atomic_files import current_directory, replacing_directory
from pec.common.checkpoint_files import TrainingState, package_versions, read_json, read_tensors, write_parts
from pec.errors import CheckpointError, ConfigError
from pec.known.enrolled import Enrolled
from pec.known.form_witness import FormWitness
from pec.known.knowing import Knowing
from pec.networks.registry import build_model
from pec.preprocessing.preprocess import Preprocess

__all__ = ["Checkpoint", "TrainingState", "read_checkpoint", "read_training_state", "write_checkpoint"]

FORMAT = 1


@dataclass(frozen=True)
class Checkpoint:
    """What is needed to classify a cloud."""

    model: nn.Module
    classes: list[str]
    preprocess: Preprocess
    temperature: float
    epoch: int
    network: str = "pec"
    """Its name, as `pec.networks.registry.build_model` takes it."""
    unknown_below: float = 0.0
    """`Prediction.known` below which an object is of no known class; 0: everything is of one. Without `knowing` that is
    the confidence."""
    none_of_these: bool = False
    """Whether the network has one output more than `classes`, the last: none of these."""

    knowing: Knowing | None = None
    """What `Prediction.known` is made of; None: of the confidence."""

    forms: FormWitness | None = None
    """What reads the forms of the surface, beside the network; None: the network is alone."""

    enrolled: Enrolled = field(default_factory=Enrolled)
    """Classes that were shown to it and not trained."""

    @property
    def n_outputs(self) -> int:
        return len(self.classes) + self.none_of_these


def write_checkpoint(
    directory: str | os.PathLike[str], checkpoint: Checkpoint, state: TrainingState | None = None
) -> None:
    """Write `directory` atomically: a reader finds the old checkpoint or the new one."""
    config = {
        "format": FORMAT,
        "network": checkpoint.network,
        "n_points": checkpoint.preprocess.n_points,
        "classes": checkpoint.classes,
        "enrolled": list(checkpoint.enrolled.names),
        "none_of_these": checkpoint.none_of_these,
        "preprocess": asdict(checkpoint.preprocess),
        "temperature": checkpoint.temperature,
        "unknown_below": checkpoint.unknown_below,
        "epoch": checkpoint.epoch,
        "versions": package_versions(),
    }
    with replacing_directory(directory) as new:
        write_parts(new, config, checkpoint.model.state_dict(), state)
        if checkpoint.knowing is not None:
            save_arrays(checkpoint.knowing.tensors(), new / "knowing.safetensors")
        if checkpoint.forms is not None:
            save_arrays(checkpoint.forms.tensors(), new / "forms.safetensors")
        if checkpoint.enrolled.names:
            shown = {str(place): each for place, each in enumerate(checkpoint.enrolled.descriptors)}
            save_arrays(shown, new / "enrolled.safetensors")


def read_checkpoint(directory: str | os.PathLike[str]) -> Checkpoint:
    """Read a checkpoint; the model is on the CPU, in evaluation mode.

    Raises CheckpointError where it is missing, incomplete, of another format, or weights and config disagree.
    """
    directory = current_directory(directory)
    config = read_json(directory / "config.json")
    try:
        network = config["network"]
        if config["format"] != FORMAT:
            raise CheckpointError(
                f"{directory}/config.json: format {config['format']}, this package reads format {FORMAT}"
            )
        preprocess = Preprocess(**config["preprocess"])
        classes = [str(name) for name in config["classes"]]
        temperature, epoch = float(config["temperature"]), int(config["epoch"])
        unknown_below = float(config.get("unknown_below", 0.0))  # older checkpoints have none
        none_of_these = bool(config.get("none_of_these", False))
        names = tuple(str(name) for name in config.get("enrolled", ()))
    except (KeyError, TypeError, ConfigError) as error:
        raise CheckpointError(f"{directory}/config.json is not a checkpoint's: {error!r}") from error
    try:
        model = build_model(network, preprocess.n_points, len(classes) + none_of_these)
    except ConfigError as error:
        raise CheckpointError(f"{directory}/config.json: {error}") from error
    tensors = read_tensors(directory / "model.safetensors")
    knowing = _read_knowing(directory / "knowing.safetensors")
    forms = _read_forms(directory / "forms.safetensors")
    enrolled = _read_enrolled(directory / "enrolled.safetensors", names)
    try:
        model.load_state_dict(tensors)
    except RuntimeError as error:
        raise CheckpointError(
            f"{directory}: the weights do not fit {len(classes)} classes and {preprocess.n_points} points: {error}"
        ) from error
    return Checkpoint(
        model.eval(),
        classes,
        preprocess,
        temperature,
        epoch,
        network,
        unknown_below,
        none_of_these,
        knowing,
        forms,
        enrolled,
    )


def read_training_state(directory: str | os.PathLike[str]) -> TrainingState | None:
    """The training state of a checkpoint, or None where there is no checkpoint. Raises CheckpointError if broken."""
    directory = current_directory(directory)
    if not directory.exists():
        return None
    return TrainingState(
        read_tensors(directory / "training_state" / "optimizer.safetensors"),
        read_json(directory / "training_state" / "progress.json"),
    )


def _read_knowing(path: Path) -> Knowing | None:
    if not path.is_file():
        return None
    try:
        return Knowing.from_tensors(load_arrays(path))
    except (SafetensorError, KeyError) as error:
        raise CheckpointError(f"{path} is broken: {error!r}") from error


def _read_forms(path: Path) -> FormWitness | None:
    if not path.is_file():
        return None
    try:
        return FormWitness.from_tensors(load_arrays(path))
    except (SafetensorError, KeyError) as error:
        raise CheckpointError(f"{path} is broken: {error!r}") from error


def _read_enrolled(path: Path, names: tuple[str, ...]) -> Enrolled:
    if not names:
        return Enrolled()
    try:
        shown = load_arrays(path)
        return Enrolled(names, tuple(shown[str(place)] for place in range(len(names))))
    except (SafetensorError, KeyError, OSError) as error:
        raise CheckpointError(f"{path} is broken: {error!r}") from error
