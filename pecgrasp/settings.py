"""Where the configs lie, and what the words of a command and its config become."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import MissingMandatoryValue

__all__ = ["CONF", "complete", "file_as_override", "plain"]

_INSTALLED = Path(__file__).parent / "conf"
CONF = str(_INSTALLED if _INSTALLED.is_dir() else Path(__file__).parents[1] / "conf")  # in a clone it lies at the top


def file_as_override(arguments: list[str]) -> list[str]:
    """The same arguments; a first one that is no override, FILE, becomes `cloud="FILE"`, whatever is in its name."""
    if not arguments or arguments[0].startswith(("-", "+", "~")) or "=" in arguments[0]:
        return arguments
    name = re.sub(r'(\\*)"', r'\1\1\\"', arguments[0])
    return [f'cloud="{name}"', *arguments[1:]]


def complete(cfg: DictConfig, command: str) -> dict[str, Any]:
    """`plain` of a config whose every `???` was filled; else the command ends and names what must be given."""
    try:
        return plain(cfg, complete=True)
    except MissingMandatoryValue as error:
        sys.exit(f"pecgrasp {command}: {error.full_key}=… must be given")


def plain(cfg: DictConfig, *, complete: bool = False) -> dict[str, Any]:
    """The settings as a dictionary, interpolations resolved; `complete` raises for a `???` that nobody has filled."""
    settings = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=complete)
    assert isinstance(settings, dict)
    return {str(key): value for key, value in settings.items()}
