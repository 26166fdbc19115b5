"""Plan grasps on clouds from files: `pecgrasp plan FILE`; settings in conf/plan.yaml."""

import re
import shlex
import sys
from pathlib import Path
from typing import Any

import hydra
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from grasping import CloudError, ConfigError, Gripper
from grasping.plan_files.plan_file import Task
from grasping.plan_files.run import cloud_paths, plan_files
from pecgrasp.from_settings import made, up_of
from pecgrasp.settings import CONF, file_as_override


@hydra.main(version_base="1.3", config_path=CONF, config_name="plan")
def plan(cfg: DictConfig) -> None:
    try:
        results = plan_files(cloud_paths(str(cfg.cloud)), task_of(cfg), Path(cfg.output), command=shlex.join(COMMAND))
    except (CloudError, ConfigError, OSError, OmegaConfBaseException) as error:
        sys.exit(f"pecgrasp plan: {str(error).splitlines()[0]}")
    print(f"\nresults: {cfg.output}/results.json, to look at: {cfg.output}/plan.html")
    if results["summary"]["failed"]:
        sys.exit(f"pecgrasp plan: {results['summary']['failed']} of {results['summary']['files']} files failed")


def task_of(cfg: DictConfig) -> Task:
    """Raises ConfigError and OmegaConf's errors for settings that make no sense."""
    chosen = cfg.gripper if cfg.gripper_file is None else gripper_of(cfg.gripper_file)
    fields: Any = OmegaConf.to_container(chosen, resolve=True)
    gripper = Gripper.from_mapping(fields)
    return Task(
        planner=made(cfg.planner, gripper=gripper),
        gripper=gripper,
        segmenter=made(cfg.segmenter) if cfg.scene else None,
        up=up_of(cfg),
        scale=cfg.scale,
    )


def gripper_of(path: str) -> Any:
    """What a gripper's file holds. Raises ConfigError for a file that cannot be read as YAML."""
    try:
        return OmegaConf.load(path)
    except (OSError, UnicodeDecodeError, YAMLError) as error:
        what = getattr(error, "problem", None) or getattr(error, "strerror", None) or error
        raise ConfigError(f"gripper={path}: {what}") from error


# The page says how it was made.
COMMAND = ["pecgrasp", "plan", *sys.argv[1:]]


def main() -> None:
    # To Hydra `gripper=` is a choice among the files of conf/gripper; a file of one's own travels by another name.
    words = [re.sub(r"^gripper=(.*\.ya?ml)$", r"gripper_file=\1", word) for word in sys.argv[1:]]
    models = [word for word in words if word.startswith("models=")]
    words = [word for word in words if word not in models] + [f"planner.{word}" for word in models]
    words += ["planner=model"] if models and not any(word.startswith("planner=") for word in words) else []
    sys.argv[1:] = file_as_override(words)
    plan()
