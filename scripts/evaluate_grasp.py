"""Evaluate the policy: `python scripts/evaluate_grasp.py checkpoint=DIR`, or a grid of cells: `experiment=table_5_2`.

The same command goes on where it was interrupted. Settings and launchers: conf/evaluate.yaml.
"""

import sys

import hydra
from omegaconf import DictConfig, OmegaConf
from tqdm import tqdm

from pecgrasp_env.evaluation.grid import run_cell


@hydra.main(version_base="1.3", config_path="../conf", config_name="evaluate")
def main(cfg: DictConfig) -> None:
    settings = OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
    try:
        with tqdm(disable=not cfg.progress, unit="episode", desc=f"{cfg.scene}, {cfg.planner_name}") as bar:

            def progress(done: int, total: int) -> None:
                bar.total = total
                if bar.n == 0:
                    bar.initial = done  # what was there already counts neither as work nor in the time left
                bar.update(done - bar.n)

            cell = run_cell(settings, progress)
    except KeyboardInterrupt:
        print(f"stopped; what is whole lies in {cfg.folder}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    done = f"{len(cell.episodes)} of {cell.wanted} episodes"
    print(f"{cell.scene}, {cell.planner}: {done}" + (f", stopped by {cell.error}" if cell.error else ""))


if __name__ == "__main__":
    main()
