"""What ends an evaluation, a single cell as well as a grid: the tables and the page of all cells in its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from pec.common.atomic_files import write_json, write_whole
from pecgrasp_env.evaluation.page import render
from pecgrasp_env.evaluation.tables import as_csv, as_results, markdown, read_evaluation


def write_evaluation(folder: Path, table: dict[str, Any], commands: list[str]) -> str:
    """FOLDER/table.md, table.csv, results.json and report.html; returns the Markdown."""
    evaluation = read_evaluation(folder, table)
    text = markdown(evaluation)
    write_whole(folder / "table.md", text)
    write_whole(folder / "table.csv", as_csv(evaluation.cells))
    write_json(folder / "results.json", as_results(evaluation))
    write_whole(folder / "report.html", render(evaluation, commands))
    return text


class WriteEvaluation(Callback):
    """Hydra's hook (see conf/evaluate.yaml): after the last cell, writes and prints the tables of `folder`."""

    def on_run_end(self, config: DictConfig, **kwargs: Any) -> None:
        self._write(config)

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        HydraConfig.instance().set_config(config)  # a launcher that works elsewhere leaves it unset here
        self._write(config)

    def _write(self, config: DictConfig) -> None:
        table: Any = OmegaConf.to_container(config.table, resolve=True)
        command = " ".join(["pecgrasp evaluate", *config.hydra.overrides.task])
        folder = Path(config.folder)
        print(write_evaluation(folder, table, [command]))
        print(f"report: {folder / 'report.html'}")
