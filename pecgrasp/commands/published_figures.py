"""Ask planners what the dissertation's figures show: `pecgrasp published-figures [instances=…]`."""

from pathlib import Path

import hydra
from hydra.utils import instantiate
from omegaconf import DictConfig

from pecgrasp.settings import CONF
from pecgrasp_env.experiments.published_figures import measure_figures


@hydra.main(version_base="1.3", config_path=CONF, config_name="published_figures")
def main(cfg: DictConfig) -> None:
    output = Path(cfg.output)
    measure_figures(instantiate(cfg.planners), first_seed=cfg.first_seed, instances=cfg.instances, output=output)
    print(f"\nresults: {output / 'results.json'}")
