"""Evaluate the policy: `pecgrasp evaluate checkpoint=DIR`, or a grid of cells: `experiment=table_5_2`.

The same command goes on where it was interrupted. Settings and launchers: conf/evaluate.yaml.
"""

import sys

import hydra
from omegaconf import DictConfig

from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, plain
from pecgrasp_env.evaluation.grid import run_cell


@hydra.main(version_base="1.3", config_path=CONF, config_name="evaluate")
def main(cfg: DictConfig) -> None:
    settings = plain(cfg, complete=True)
    try:
        with progress_bar("episode", shown=cfg.progress, title=f"{cfg.scene}, {cfg.planner_name}") as progress:
            cell = run_cell(settings, progress)
    except KeyboardInterrupt:
        print(f"stopped; what is whole lies in {cfg.folder}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    done = f"{len(cell.episodes)} of {cell.wanted} episodes"
    print(f"{cell.scene}, {cell.planner}: {done}" + (f", stopped by {cell.error}" if cell.error else ""))
