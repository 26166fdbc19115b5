"""See all of it work: `pecgrasp demo`; settings in conf/demo.yaml."""

import sys

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from pecgrasp.settings import CONF, plain


@hydra.main(version_base="1.3", config_path=CONF, config_name="demo")
def main(cfg: DictConfig) -> None:
    from pecgrasp_env.demo.run import run_demo  # here, so that the processes it starts need not load it all

    overrides = HydraConfig.get().overrides.task
    command = " ".join(["pecgrasp demo", *overrides])
    try:
        run_demo(plain(cfg), OmegaConf.to_yaml(cfg, resolve=True), command)
    except KeyboardInterrupt:
        print("\nstopped; the same command goes on from here", file=sys.stderr)
        sys.exit(130)
