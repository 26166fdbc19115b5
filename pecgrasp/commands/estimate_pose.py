"""Find known objects in a cloud: `pecgrasp estimate-pose FILE models=FOLDER`; settings in conf/estimate_pose.yaml."""

import shlex
import sys
from pathlib import Path

import hydra
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from grasping import CloudError, ConfigError, ModelError, PoseEstimator, load_models
from grasping.pose.pose_file import estimate_file
from pecgrasp.settings import CONF, file_as_override


@hydra.main(version_base="1.3", config_path=CONF, config_name="estimate_pose")
def estimate(cfg: DictConfig) -> None:
    try:
        classes = None if cfg.classes is None else list(cfg.classes)
        models = load_models(cfg.models, classes=classes, scale=cfg.models_scale, allow_open=cfg.allow_open)
        estimate_file(
            Path(cfg.cloud),
            PoseEstimator(models),
            Path(cfg.output),
            scene=cfg.scene,
            scale=cfg.scale,
            viewpoint=None if cfg.viewpoint is None else list(cfg.viewpoint),
            command=shlex.join(COMMAND),
        )
    except (CloudError, ConfigError, ModelError, ImportError, OSError, OmegaConfBaseException) as error:
        sys.exit(f"pecgrasp estimate-pose: {str(error).splitlines()[0]}")
    print(f"\nresults: {cfg.output}/results.json, to look at: {cfg.output}/poses.html")


# The page says how it was made.
COMMAND = ["pecgrasp", "estimate-pose", *sys.argv[1:]]


def main() -> None:
    sys.argv[1:] = file_as_override(sys.argv[1:])
    estimate()
