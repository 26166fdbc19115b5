"""Classify corrupted test clouds with trained classifiers: `pecgrasp robustness runs=[DIR,DIR]`."""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pec.common.atomic_files import write_json, write_whole
from pec.errors import CheckpointError, ConfigError, DatasetError
from pec.experiments.robustness import measure_robustness, robustness_table
from pecgrasp.own_clouds import packed_clouds
from pecgrasp.settings import CONF


@hydra.main(version_base="1.3", config_path=CONF, config_name="robustness")
def main(cfg: DictConfig) -> None:
    try:
        data = cfg.data and str(packed_clouds(Path(cfg.data), 1.0, Path("outputs/cache")) or cfg.data)
        runs = [cfg.runs] if isinstance(cfg.runs, str) else list(cfg.runs)
        rows = measure_robustness(runs, data=data, seed=cfg.seed, progress=cfg.progress)
    except (CheckpointError, ConfigError, DatasetError) as error:
        sys.exit(f"pecgrasp robustness: {error}")
    table = robustness_table(rows)
    print(table)
    output = Path(cfg.output)
    write_whole(output / "table.md", table)
    write_json(output / "results.json", {"rows": rows})
