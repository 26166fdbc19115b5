"""Train a network that judges or proposes grasps: `pecgrasp train-grasps dataset.path=DIR`; conf/train_grasps.yaml."""

import sys
from typing import Any

import hydra
from omegaconf import DictConfig

from pec.errors import CheckpointError, ConfigError, DatasetError, TrainingError
from pec.grasps.training.train import train_grasps
from pecgrasp.settings import CONF, complete


@hydra.main(version_base="1.3", config_path=CONF, config_name="train_grasps")
def main(cfg: DictConfig) -> None:
    settings = complete(cfg, "train-grasps")
    try:
        results = train_grasps(settings)
    except (CheckpointError, ConfigError, DatasetError, TrainingError) as error:
        sys.exit(f"pecgrasp train-grasps: {error}")
    except KeyboardInterrupt:
        print(f"stopped; all finished epochs lie in {cfg.output}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    print(table(results))


def table(results: dict[str, Any]) -> str:
    """The figures on the test instances, to print."""
    sizes = results["data_sizes"]["test"]
    lines = [
        f"{results['network']}: {results['parameters']:,} parameters, {results['multiply_adds']:,} multiply-adds",
        f"{sizes['instances']} unseen instances, {sizes['scenes']} scenes, {sizes['grasps']} grasps",
    ]
    test = results["test"]
    if "covered" in test:
        lines.append(f"of {test['held']} grasps that held {test['covered']:.1%} have a drawn one near them")
    else:
        lines.append(f"{'grasps of':24}{'n':>7}{'held':>8}{'AUC':>7}{'AP':>7}{'top one':>9}{'chance':>8}{'scenes':>8}")
        for name, row in test.items():
            figures = f"{row['auc']:>7.3f}{row['average_precision']:>7.3f}{row['top_one']:>9.1%}{row['chance']:>8.1%}"
            lines.append(f"{name:24}{row['grasps']:>7}{row['held']:>8.1%}{figures}{row['scenes']:>8}")
    return "\n".join([*lines, f"{results['training_s']:.0f} s; checkpoint: {results['checkpoint']}"])
