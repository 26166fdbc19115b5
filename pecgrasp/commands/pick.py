"""One pick with a real arm: `pecgrasp pick`; settings in conf/pick.yaml."""

import sys
from contextlib import closing
from typing import Any

import hydra
from hydra.utils import instantiate
from omegaconf import DictConfig

from pecgrasp.settings import CONF, complete
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.interfaces import DepthCamera
from pecgrasp_env.real.pick_run import run_pick

failed: list[str] = []


def asked(doing: str) -> bool:
    """Whether the user says y; nobody there is a no."""
    try:
        return input(f"{doing}? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        return False


def opened(camera: dict[str, Any]) -> DepthCamera:
    """The camera of its settings, with its own errors: Hydra would wrap them."""
    return instantiate(camera, _partial_=True)()


def classifier_of(checkpoint: str | None):
    if checkpoint is None:
        return None
    from pec import Classifier

    return Classifier.load(checkpoint)


@hydra.main(version_base="1.3", config_path=CONF, config_name="pick")
def pick(cfg: DictConfig) -> None:
    settings = complete(cfg, "pick")
    try:
        classifier = classifier_of(cfg.checkpoint)
        with closing(opened(settings["camera"])) as camera:
            good = run_pick(settings, camera, classifier, instantiate(settings["planner"]), asked, print)
    except (RobotError, MotionError, ValueError, OSError) as error:
        sys.exit(f"pecgrasp pick: {type(error).__name__}: {error}")
    if not good:
        failed.append(cfg.target)


def main() -> None:
    failed.clear()
    pick()
    if failed:
        sys.exit(1)
