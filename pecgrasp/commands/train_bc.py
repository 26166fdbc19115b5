"""Learn from demonstrations: `pecgrasp train-bc demos=DIR/trajectory.h5`; settings in conf/train_bc.yaml."""

import sys

import hydra
import torch
from omegaconf import DictConfig

from pecgrasp.settings import CONF, plain
from pecgrasp_env.learning.behaviour_cloning import CloningConfig, train
from pecgrasp_env.learning.state_features import MomentsError


@hydra.main(version_base="1.3", config_path=CONF, config_name="train_bc")
def main(cfg: DictConfig) -> None:
    torch.set_num_threads(1)
    try:
        results = train(CloningConfig(**plain(cfg, complete=True)))
    except (MomentsError, FileNotFoundError) as error:
        sys.exit(f"pecgrasp train-bc: {error}")
    print(f"{results['demonstrations']} demonstrations, {results['samples']} samples, {results['seconds']:.0f} s")
    print(f"{'':10}{'success, 95 %':>24}{'held, 95 %':>24}{'return':>16}{'closest, mm':>13}")
    for name, row in results["final"].items():
        cells = [f"{row[key]['count']}/{row['episodes']}, {interval(row[key])}" for key in ("success", "held")]
        mean, deviation = row["return"]["mean"], row["return"]["standard_error"]
        print(f"{name:10}{cells[0]:>24}{cells[1]:>24}{mean:>9.2f} ± {deviation:<4.2f}{1000 * row['closest_m']:>13.0f}")


def interval(share: dict) -> str:
    low, high = share["interval"]
    return f"{low:.1%}–{high:.1%}"
