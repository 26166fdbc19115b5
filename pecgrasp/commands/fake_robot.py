"""A robot that is not there: `pecgrasp fake-robot`; settings in conf/fake_robot.yaml."""

import sys
from contextlib import suppress
from typing import Any

import hydra
import numpy as np
from omegaconf import DictConfig

from pecgrasp.settings import CONF, plain
from pecgrasp_env.real.fakes.controller import CB3, E_SERIES
from pecgrasp_env.real.fakes.fake_robot import FakeRobot
from pecgrasp_env.real.fakes.plant import FollowingJoints, Plant
from pecgrasp_env.real.ur_models import URModel
from pecgrasp_env.robot.arm_lengths import UR5

_PERIODS = {"CB3": 0.008, "e-Series": 0.002}  # s


def _plant(settings: dict[str, Any]) -> Plant:
    arm = URModel.from_mapping(settings["robot"]).lengths
    if settings["scene"] == "joints":
        return FollowingJoints(_PERIODS[settings["robot"]["series"]], settings["between"], arm)
    if settings["scene"] != "simulated":
        sys.exit(f"pecgrasp fake-robot: scene={settings['scene']}: must be simulated or joints")
    if not np.array_equal(arm.dh, UR5.dh):
        sys.exit(f"pecgrasp fake-robot: robot={settings['robot']['name']}: the simulated scene has a UR5; scene=joints")
    from pecgrasp_env.envs.simulated_robot import SimulatedRobot

    return SimulatedRobot(settings["seed"], render_backend="cpu", **settings["env"])


@hydra.main(version_base="1.3", config_path=CONF, config_name="fake_robot")
def fake_robot(cfg: DictConfig) -> None:
    settings = plain(cfg)
    version = CB3 if cfg.robot.series == "CB3" else E_SERIES
    try:
        plant = _plant(settings)
        robot = FakeRobot(plant, cfg.host, version, cfg.robot.name, active=cfg.active, pace=cfg.pace)
    except ValueError as error:
        sys.exit(f"pecgrasp fake-robot: {error}")
    except OSError as error:
        sys.exit(f"pecgrasp fake-robot: {cfg.host}: {error.strerror}; another one runs there: host=127.0.0.2")
    print(f"{cfg.robot.name} at {cfg.host}, {plant.report().get('target', 'no scene')}", flush=True)
    with suppress(KeyboardInterrupt):
        robot.run()


def main() -> None:
    fake_robot()
