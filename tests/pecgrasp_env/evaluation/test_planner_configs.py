"""Every file of conf/planner makes a planner that plans on an object on a table."""

from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import OmegaConf

import grasping
from pecgrasp_env.objects import make_object

CONF = Path(__file__).parents[3] / "conf"
NAMES = sorted(path.stem for path in (CONF / "planner").glob("*.yaml"))


def test_every_planner_of_the_library_has_a_file():
    with initialize_config_dir(str(CONF), version_base="1.3"):
        targets = {compose(f"planner/{name}").planner["_target_"] for name in NAMES}
    planners = {f"grasping.{name}" for name in grasping.__all__ if name.endswith("Planner") and name != "GraspPlanner"}
    assert targets == planners


@pytest.mark.parametrize("name", NAMES)
def test_a_planner_chosen_by_name_plans(name):
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("evaluate", overrides=["checkpoint=x", f"planner={name}"])
    planner = instantiate(OmegaConf.to_container(cfg.planner))
    points = np.asarray(make_object("mouse", 0).visual_mesh().sample(600, seed=0), float)
    points[:, 2] -= points[:, 2].min()
    plan = planner.plan(points, up=(0, 0, 1), table=(0, 0, 1, 0), obstacles=points + np.array([0.3, 0.0, 0.0]))
    assert (plan.best is None) == (plan.reason is not None)
    assert plan.best is None or plan.best.pose.shape == (4, 4)
