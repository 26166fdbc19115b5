"""What realism buys: train on each kind of data set, test on the robot's own clouds; settings in conf/transfer.yaml."""

import sys

import hydra
from omegaconf import DictConfig

from pecgrasp.settings import CONF, plain


@hydra.main(version_base="1.3", config_path=CONF, config_name="transfer")
def main(cfg: DictConfig) -> None:
    from pec.errors import CheckpointError, ConfigError, DatasetError
    from pecgrasp_env.capture import CaptureError
    from pecgrasp_env.experiments.transfer import run_transfer, table
    from pecgrasp_env.objects import ObjectError

    try:
        results = run_transfer(plain(cfg))
    except (CaptureError, CheckpointError, ConfigError, DatasetError, ObjectError) as error:
        sys.exit(f"pecgrasp transfer: {error}")
    print(f"\nbest first:\n{table(results)}\nresults: {cfg.out}/results.json")
