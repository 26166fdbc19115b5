"""Which trained networks a planner's settings name, by content: another checkpoint at the same place is another one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pec.common.run_identity import files_key, flat_settings

__all__ = ["checkpoint_key", "network_keys"]


def checkpoint_key(directory: str) -> str:
    """Hash of a checkpoint's files, wherever they lie; "missing" where it is not."""
    files = [Path(directory) / name for name in ("config.json", "model.safetensors")]
    return files_key(files) if all(file.is_file() for file in files) else "missing"


def network_keys(planner: Mapping[str, Any]) -> dict[str, str]:
    """`checkpoint_key` of each setting, by its dotted name, that is a checkpoint's directory."""
    settings = flat_settings(planner)
    directories = {name: value for name, value in settings.items() if isinstance(value, str) and Path(value).is_dir()}
    keys = {name: checkpoint_key(value) for name, value in directories.items()}
    return {name: key for name, key in keys.items() if key != "missing"}  # a folder of meshes is none
