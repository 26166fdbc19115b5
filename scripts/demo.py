"""See all of it work: `python scripts/demo.py`; settings in conf/demo.yaml."""

import sys

import hydra
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf


@hydra.main(version_base="1.3", config_path="../conf", config_name="demo")
def main(cfg: DictConfig) -> None:
    from pecgrasp_env.demo.run import run_demo  # here, so that the processes it starts need not load it all

    overrides = HydraConfig.get().overrides.task
    command = " ".join(["python scripts/demo.py", *overrides]) if overrides else "make demo"
    try:
        run_demo(OmegaConf.to_container(cfg, resolve=True), OmegaConf.to_yaml(cfg, resolve=True), command)
    except KeyboardInterrupt:
        print("\nstopped; the same command goes on from here", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
