"""The files that checkpoints are made of: JSON and safetensors, read with errors that name the file, and written."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from pec.errors import CheckpointError

__all__ = ["TrainingState", "package_versions", "read_config", "read_json", "read_tensors", "write_parts"]


@dataclass(frozen=True)
class TrainingState:
    """What is needed to go on training."""

    optimizer: dict[str, torch.Tensor]
    progress: dict[str, Any]


def read_json(path: Path) -> dict[str, Any]:
    """The mapping in a JSON file. Raises CheckpointError where it is missing or broken."""
    if not path.is_file():
        raise CheckpointError(f"no checkpoint: {path} does not exist")
    try:
        content = json.loads(path.read_text())
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise CheckpointError(f"{path} is broken: {error}") from error
    if not isinstance(content, dict):
        raise CheckpointError(f"{path} is not a checkpoint's: it holds a {type(content).__name__}")
    return content


def read_config(directory: Path, kind: str, number: int, what: str) -> dict[str, Any]:
    """The config.json of a checkpoint of a kind, whose format has a number; ``what`` it is of, in the message.

    Raises CheckpointError where it is missing, broken, or of another kind or format.
    """
    config = read_json(directory / "config.json")
    if config.get("kind") != kind or config.get("format") != number:
        raise CheckpointError(
            f"{directory} is no checkpoint of {what} of format {number}: config.json says "
            f"kind {config.get('kind', 'classifier')!r}, format {config.get('format')!r}"
        )
    return config


def read_tensors(path: Path) -> dict[str, torch.Tensor]:
    """The tensors in a safetensors file, on the CPU. Raises CheckpointError where it is missing or broken."""
    if not path.is_file():
        raise CheckpointError(f"no checkpoint: {path} does not exist")
    try:
        return load_file(path)
    except SafetensorError as error:
        raise CheckpointError(f"{path} is broken: {error}") from error


def package_versions() -> dict[str, str]:
    """What a checkpoint says it was written by."""
    try:
        ours = version("pecgrasp")
    except PackageNotFoundError:
        ours = "not installed"
    return {"pecgrasp": ours, "torch": torch.__version__, "numpy": np.__version__, "python": platform.python_version()}


def write_parts(
    directory: Path,
    config: Mapping[str, Any],
    weights: Mapping[str, torch.Tensor],
    state: TrainingState | None,
) -> None:
    """config.json, model.safetensors and, where training goes on from here, training_state/ in an empty directory."""
    (directory / "config.json").write_text(json.dumps(config, indent=1) + "\n")
    save_file({name: t.detach().cpu().contiguous() for name, t in weights.items()}, directory / "model.safetensors")
    if state is not None:
        (directory / "training_state").mkdir()
        save_file(state.optimizer, directory / "training_state" / "optimizer.safetensors")
        (directory / "training_state" / "progress.json").write_text(json.dumps(state.progress) + "\n")
