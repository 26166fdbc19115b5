"""One pick with a real arm: `pecgrasp pick`; settings in conf/pick.yaml."""

import sys

import hydra
from hydra.utils import instantiate
from omegaconf import DictConfig
from omegaconf.errors import MissingMandatoryValue

from pecgrasp.settings import CONF, plain
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.pick_run import run_pick

failed: list[str] = []


def _asked(doing: str) -> bool:
    return input(f"{doing}? [y/N] ").strip().lower() in ("y", "yes")


def _classifier(checkpoint: str | None):
    if checkpoint is None:
        return None
    from pec import Classifier

    return Classifier.load(checkpoint)


@hydra.main(version_base="1.3", config_path=CONF, config_name="pick")
def pick(cfg: DictConfig) -> None:
    try:
        settings = plain(cfg, complete=True)
    except MissingMandatoryValue as error:
        sys.exit(f"pecgrasp pick: {error.full_key}=… must be given")
    try:
        classifier = _classifier(cfg.checkpoint)
        camera = instantiate(settings["camera"])
        try:
            good = run_pick(settings, camera, classifier, instantiate(settings["planner"]), _asked, print)
        finally:
            camera.close()
    except (RobotError, MotionError, ValueError, OSError) as error:
        sys.exit(f"pecgrasp pick: {type(error).__name__}: {error}")
    if not good:
        failed.append(cfg.target)


def main() -> None:
    failed.clear()
    pick()
    if failed:
        sys.exit(1)
