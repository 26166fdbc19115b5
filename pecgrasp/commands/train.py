"""Train a classifier: `pecgrasp train dataset.path=DIR`; settings and their meaning in conf/train.yaml."""

import re
import sys
from typing import Any

import hydra
from omegaconf import DictConfig

from pec.errors import CheckpointError, ConfigError, DatasetError, TrainingError
from pec.training.loop import train
from pecgrasp.own_clouds import with_own_clouds
from pecgrasp.settings import CONF, plain


@hydra.main(version_base="1.3", config_path=CONF, config_name="train")
def training(cfg: DictConfig) -> float:
    settings = plain(cfg)
    del settings["name"]  # only names the output folder
    try:
        results = train(with_own_clouds(settings))
    except (CheckpointError, ConfigError, DatasetError, TrainingError) as error:
        sys.exit(f"pecgrasp train: {error}")
    except KeyboardInterrupt:
        print(f"stopped; all finished epochs lie in {cfg.output}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    print(f"{results['protocol']}; seed {results['seed']}, {results['training_s']:.0f} s")
    print(f"{'':6}{'epoch':>6}{'selection %':>13}{'test %':>9}{'calibration error %':>21}")
    for name in ("best", "last"):
        row = results[name]
        print(
            f"{name:6}{row['epoch']:>6}{100 * row['selection_accuracy']:>13.2f}{100 * row['test_accuracy']:>9.2f}"
            f"{100 * row['test_calibration_error']:>21.2f}"
        )
    print(_products(results["precision"]))
    for warning in results["warnings"]:
        print(f"warning: {warning}")
    print(f"checkpoint: {results['checkpoint']}")
    return results["best"]["test_accuracy"]


def main() -> None:
    sys.argv[1:] = [re.sub("^path=", "dataset.path=", word) for word in sys.argv[1:]]
    training()


def _products(precision: dict[str, Any]) -> str:
    line = f"products in {precision['used']}"
    speedup = precision["bfloat16_speedup"]
    if speedup is not None:
        line += f" (protocol.precision=auto: bfloat16 was {speedup:.3g} times as fast when the run began)"
    return line
