"""What the commands on clouds make of their settings."""

from __future__ import annotations

from typing import Any

from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from grasping.errors import ConfigError
from grasping.plan_files.run import frame_up

__all__ = ["made", "up_of"]


def made(section: DictConfig, **more: object) -> Any:
    """What `_target_` makes of a section's settings. Raises ConfigError for one that it does not take."""
    try:
        return instantiate(section, _partial_=True)(**more)
    except (TypeError, InstantiationException) as error:
        why = " ".join(str(error).split())  # Hydra says on a second line what went wrong
        raise ConfigError(f"{section.get('_target_')}: {why}") from error


def up_of(cfg: DictConfig) -> Any:
    """(3,) away from the table by the settings `up` and `frame`; None: unknown. Raises ConfigError for a frame."""
    if cfg.up is None:
        return frame_up(cfg.frame)
    return list(cfg.up) if OmegaConf.is_list(cfg.up) else cfg.up
