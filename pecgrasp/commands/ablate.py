"""Train a grid, set it beside the published figures: `pecgrasp ablate experiment=table_4_1 dataset.path=FILE`.

The same command skips the cells that are done. Hydra's launchers spread them: see conf/ablate.yaml.
"""

import sys

import hydra
from omegaconf import DictConfig

from pec.errors import ConfigError, DatasetError
from pec.experiments.grid import run_cell
from pecgrasp.own_clouds import with_own_clouds
from pecgrasp.settings import CONF, complete


@hydra.main(version_base="1.3", config_path=CONF, config_name="ablate")
def main(cfg: DictConfig) -> None:
    try:
        settings = with_own_clouds(complete(cfg, "ablate"))
    except (ConfigError, DatasetError) as error:
        sys.exit(f"pecgrasp ablate: {error}")
    cell = run_cell(settings)
    print(f"cell {cell['key']}: {cell['status']}" + (f", {cell['error']}" if cell["error"] else ""))
