"""Train the pose network: `pecgrasp train-pose dataset.path=DIR [models=FILE]`; settings in conf/train_pose.yaml."""

import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig

from pec.errors import CheckpointError, ConfigError, DatasetError, ModelsError, TrainingError
from pec.pose.train import train_pose
from pecgrasp.progress import progress_bar
from pecgrasp.settings import CONF, plain


@hydra.main(version_base="1.3", config_path=CONF, config_name="train_pose")
def main(cfg: DictConfig) -> None:
    try:
        settings = plain(cfg, complete=True)
        if settings["models"] is None:
            settings["models"] = str(_models_of(Path(settings["dataset"]["path"]), cfg.progress))
        results = train_pose(settings)
    except (CheckpointError, ConfigError, DatasetError, ImportError, ModelsError, TrainingError) as error:
        sys.exit(f"pecgrasp train-pose: {error}")
    except KeyboardInterrupt:
        print(f"stopped; all finished epochs lie in {cfg.output}, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    split = "test" if "test" in results else "validation"
    print(f"{split} clouds, before any refinement; % of the likeliest proposal and of the one nearest to the truth")
    print(f"{'model':40}{'n':>6}{'ADD < 10 %':>14}{'nearest':>9}{'ADD-S < 2 cm':>14}{'nearest':>9}")
    for name, row in results[split].items():
        shares = [100 * row[which][figure] for figure in ("add_10", "add_s_2cm") for which in ("likeliest", "nearest")]
        print(f"{name:40}{row['n']:>6}{shares[0]:>14.1f}{shares[1]:>9.1f}{shares[2]:>14.1f}{shares[3]:>9.1f}")
    print(f"{results['training_s']:.0f} s; checkpoint: {results['checkpoint']}")


def _models_of(directory: Path, progress: bool) -> Path:
    """The models of a generated data set, made of its meshes where nobody has yet."""
    path = directory / "models.safetensors"
    if not path.is_file():
        from pecgrasp_env.capture.pose_models import write_pose_models  # needs what reads meshes; the file does not

        with progress_bar("model", shown=progress, title="symmetries") as advance:
            write_pose_models(directory, path, advance)
    return path
