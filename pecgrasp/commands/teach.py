"""A new class from the thing itself: `pecgrasp teach`; settings in conf/teach.yaml."""

import sys

import hydra
from omegaconf import DictConfig
from omegaconf.errors import MissingMandatoryValue

from pec import Classifier
from pecgrasp.commands.pick import asked, opened
from pecgrasp.settings import CONF, plain
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.teach_run import run_teach


@hydra.main(version_base="1.3", config_path=CONF, config_name="teach")
def teach(cfg: DictConfig) -> None:
    try:
        settings = plain(cfg, complete=True)
    except MissingMandatoryValue as error:
        sys.exit(f"pecgrasp teach: {error.full_key}=… must be given")
    try:
        classifier = Classifier.load(settings["checkpoint"])
        camera = opened(settings["camera"])
        try:
            run_teach(settings, camera, classifier, asked, print)
        finally:
            camera.close()
    except (RobotError, ValueError, OSError) as error:
        sys.exit(f"pecgrasp teach: {error}")


def main() -> None:
    teach()
