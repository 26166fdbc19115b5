"""Evaluate the policy: `pecgrasp evaluate checkpoint=DIR`, or a grid of cells: `experiment=table_5_2`.

The same command goes on where it was interrupted. Settings and launchers: conf/evaluate.yaml.
"""

import sys

import hydra
from omegaconf import DictConfig
from omegaconf.errors import MissingMandatoryValue

from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, plain
from pecgrasp_env.evaluation.grid import run_cell

failed: list[str] = []


@hydra.main(version_base="1.3", config_path=CONF, config_name="evaluate")
def evaluate(cfg: DictConfig) -> None:
    try:
        settings = plain(cfg, complete=True)
    except MissingMandatoryValue as error:
        way = " (DIR/best of a training run; null where one class alone lies on the table)"
        sys.exit(f"pecgrasp evaluate: {error.full_key}=… must be given{way * (error.full_key == 'checkpoint')}")
    try:
        with progress_bar("episode", shown=cfg.progress, title=f"{cfg.scene}, {cfg.planner_name}") as progress:
            cell = run_cell(settings, progress)
    except KeyboardInterrupt:
        print(f"stopped; what is whole lies in {cfg.folder}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    done = f"{len(cell.episodes)} of {cell.wanted} episodes"
    print(f"{cell.scene}, {cell.planner}: {done}" + (f", stopped by {cell.error}" if cell.error else ""))
    if cell.error:
        failed.append(cell.error)


def main() -> None:
    failed.clear()
    evaluate()
    if failed:  # after the other cells of a grid, and the tables of all
        sys.exit(f"pecgrasp evaluate: {len(failed)} cell{'s' * (len(failed) > 1)} stopped by an error")
