"""Hydra's hook for a grid: its launcher runs the cells, and when all have ended the table is written."""

from __future__ import annotations

from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from pec.experiments.grid_table import write_table

__all__ = ["WriteTable"]


class WriteTable(Callback):
    """Writes and prints the table of `folder` after a multirun (see conf/ablate.yaml)."""

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        HydraConfig.instance().set_config(config)  # a launcher that works elsewhere leaves it unset here
        table = OmegaConf.to_container(config.table, resolve=True)
        assert isinstance(table, dict)
        print(write_table(config.folder, str(table["title"]), table["published"]))
