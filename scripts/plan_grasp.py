"""Plan grasps on clouds from files: `python scripts/plan_grasp.py cloud=FILE`; settings in conf/plan.yaml."""

import re
import shlex
import sys
from pathlib import Path
from typing import Any

import hydra
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from grasping import CloudError, ConfigError, Gripper
from grasping.plan_files.plan_file import Task
from grasping.plan_files.run import cloud_paths, frame_up, plan_files


@hydra.main(version_base="1.3", config_path="../conf", config_name="plan")
def main(cfg: DictConfig) -> None:
    try:
        results = plan_files(cloud_paths(str(cfg.cloud)), task_of(cfg), Path(cfg.output), command=shlex.join(COMMAND))
    except (CloudError, ConfigError, OSError, OmegaConfBaseException) as error:
        sys.exit(f"plan_grasp: {str(error).splitlines()[0]}")
    print(f"\nresults: {cfg.output}/results.json, to look at: {cfg.output}/plan.html")
    if results["summary"]["failed"]:
        sys.exit(f"plan_grasp: {results['summary']['failed']} of {results['summary']['files']} files failed")


def task_of(cfg: DictConfig) -> Task:
    """Raises ConfigError and OmegaConf's errors for settings that make no sense."""
    chosen = cfg.gripper if cfg.gripper_file is None else gripper_of(cfg.gripper_file)
    gripper = Gripper.from_mapping(OmegaConf.to_container(chosen, resolve=True))
    up = list(cfg.up) if OmegaConf.is_list(cfg.up) else cfg.up
    return Task(
        planner=made(cfg.planner, gripper=gripper),
        gripper=gripper,
        segmenter=made(cfg.segmenter) if cfg.scene else None,
        up=frame_up(cfg.frame) if cfg.up is None else up,
        scale=cfg.scale,
    )


def gripper_of(path: str) -> Any:
    """What a gripper's file holds. Raises ConfigError for a file that cannot be read as YAML."""
    try:
        return OmegaConf.load(path)
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        what = getattr(error, "problem", None) or getattr(error, "strerror", None) or error
        raise ConfigError(f"gripper={path}: {what}") from error


def made(section: DictConfig, **more: object) -> Any:
    """What `_target_` makes of a section's settings. Raises ConfigError for one that it does not take."""
    try:
        return instantiate(section, _partial_=True)(**more)
    except (TypeError, InstantiationException) as error:
        raise ConfigError(f"{section.get('_target_')}: {error}") from error


COMMAND = ["python", "scripts/plan_grasp.py", *sys.argv[1:]]

if __name__ == "__main__":
    # To Hydra `gripper=` is a choice among the files of conf/gripper; a file of one's own travels by another name.
    sys.argv[1:] = [re.sub(r"^gripper=(.*\.ya?ml)$", r"gripper_file=\1", word) for word in sys.argv[1:]]
    main()
