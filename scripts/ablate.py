"""Train a grid, set it beside the published figures: `python scripts/ablate.py experiment=table_4_1 dataset.path=FILE`.

The same command skips the cells that are done. Hydra's launchers spread them: see conf/ablate.yaml.
"""

import hydra
from omegaconf import DictConfig, OmegaConf

from pec.experiments.grid import run_cell


@hydra.main(version_base="1.3", config_path="../conf", config_name="ablate")
def main(cfg: DictConfig) -> None:
    cell = run_cell(OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True))
    print(f"cell {cell['key']}: {cell['status']}" + (f", {cell['error']}" if cell["error"] else ""))


if __name__ == "__main__":
    main()
