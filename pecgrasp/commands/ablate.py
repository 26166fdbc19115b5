"""Train a grid, set it beside the published figures: `pecgrasp ablate experiment=table_4_1 dataset.path=FILE`.

The same command skips the cells that are done. Hydra's launchers spread them: see conf/ablate.yaml.
"""

import hydra
from omegaconf import DictConfig

from pec.experiments.grid import run_cell
from pecgrasp.settings import CONF, plain


@hydra.main(version_base="1.3", config_path=CONF, config_name="ablate")
def main(cfg: DictConfig) -> None:
    cell = run_cell(plain(cfg, complete=True))
    print(f"cell {cell['key']}: {cell['status']}" + (f", {cell['error']}" if cell["error"] else ""))
