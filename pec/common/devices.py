"""Where torch computes."""

from __future__ import annotations

import torch

from pec.errors import ConfigError

__all__ = ["device_named"]


def device_named(name: str) -> torch.device:
    """cpu, cuda, or auto: CUDA where there is one. Raises ConfigError where it was asked for and is not there."""
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device=cuda, but torch finds no CUDA device")
    return torch.device("cuda" if name == "auto" and torch.cuda.is_available() else name.replace("auto", "cpu"))
