"""The files that checkpoints are made of: JSON and safetensors, read with errors that name the file."""

from __future__ import annotations

import json
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from pec.errors import CheckpointError

__all__ = ["package_versions", "read_json", "read_tensors"]


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
