"""A new class from the thing itself: `pecgrasp teach`; settings in conf/teach.yaml."""

import sys
from contextlib import closing

import hydra
from omegaconf import DictConfig

from pec import Classifier
from pecgrasp.commands.pick import asked, opened
from pecgrasp.settings import CONF, complete
from pecgrasp_env.real.errors import RobotError
from pecgrasp_env.real.teach_run import run_teach


@hydra.main(version_base="1.3", config_path=CONF, config_name="teach")
def teach(cfg: DictConfig) -> None:
    settings = complete(cfg, "teach")
    try:
        classifier = Classifier.load(settings["checkpoint"])
        with closing(opened(settings["camera"])) as camera:
            run_teach(settings, camera, classifier, asked, print)
    except (RobotError, ValueError, OSError) as error:
        sys.exit(f"pecgrasp teach: {error}")


def main() -> None:
    teach()
