"""Train a network that gives every point a class: `pecgrasp train-points frames=DIR`; conf/train_points.yaml."""

import sys
from pathlib import Path
from typing import Any

import hydra
from omegaconf import DictConfig

from pec.errors import CheckpointError, ConfigError, DatasetError, TrainingError
from pec.segmentation.train import train_points
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, complete
from pecgrasp_env.capture.scenes.table_clouds import check_apart, table_clouds


@hydra.main(version_base="1.3", config_path=CONF, config_name="train_points")
def main(cfg: DictConfig) -> None:
    settings = complete(cfg, "train-points")
    frames, test, stored = settings.pop("frames"), settings.pop("test_frames"), settings.pop("stored_points")
    try:
        if test is not None:
            check_apart(Path(frames), Path(test))
        for name, folder in (("clouds", frames), ("test", test)):
            with progress_bar("frame", shown=cfg.progress, title=f"clouds of {folder}") as progress:
                settings[name] = None if folder is None else str(table_clouds(Path(folder), stored, progress))
        results = train_points(settings)
    except (CheckpointError, ConfigError, DatasetError, TrainingError) as error:
        sys.exit(f"pecgrasp train-points: {error}")
    except KeyboardInterrupt:
        print(f"stopped; all finished epochs lie in {cfg.output}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    print(
        f"{results['network']}, seed {results['seed']}: {results['parameters']:,} parameters, best of "
        f"{len(results['curves']['loss_train'])} epochs {results['best']['epoch']}, {results['training_s']:.0f} s"
    )
    print(
        f"{'points':>8}{'split':>12}{'clouds':>8}{'accuracy %':>12}{'mean IoU %':>12}{'M multiply-adds':>17}{'ms':>8}"
    )
    for row in results["at_points"]:
        for split, n_clouds in results["n_clouds"].items():
            if split in row:
                print(_line(row, split, n_clouds))
    print(f"checkpoint: {results['checkpoint']}")


def _line(row: dict[str, Any], split: str, n_clouds: int) -> str:
    figures = row[split]
    return (
        f"{row['n_points']:>8}{split:>12}{n_clouds:>8}{100 * figures['accuracy']:>12.1f}"
        f"{100 * figures['mean_iou']:>12.1f}{row['multiply_adds'] / 1e6:>17.1f}{row['network_ms']:>8.1f}"
    )
