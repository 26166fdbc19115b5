"""Every file of conf/planner makes a planner that finds a grasp of an object on a table."""

from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from hydra.utils import instantiate
from omegaconf import OmegaConf

import grasping
from grasping import ROBOTIQ_2F_140
from pec.grasps.checkpoint import GraspCheckpoint, write_grasp_checkpoint
from pec.grasps.network import NetworkConfig, build_network
from pecgrasp_env.objects import make_object

CONF = Path(__file__).parents[3] / "conf"
NAMES = sorted(path.stem for path in (CONF / "planner").glob("*.yaml"))
LEARNED = {  # name: the networks that it wants, by setting
    "gpd": {"scores.directory": "gpd"},
    "pointnetgpd": {"scores.directory": "pointnetgpd"},
    "graspnet": {"scores.directory": "graspnet_evaluator", "propose.sampler": "graspnet_sampler"},
    "rerank": {"rerank.directory": "pointnetgpd"},
}


def test_every_planner_of_the_library_has_a_file():
    with initialize_config_dir(str(CONF), version_base="1.3"):
        targets = {compose(f"planner/{name}").planner["_target_"] for name in NAMES}
    planners = {f"grasping.{name}" for name in grasping.__all__ if name.endswith("Planner") and name != "GraspPlanner"}
    assert targets == planners


@pytest.mark.parametrize("name", [name for name in NAMES if name not in LEARNED])
@pytest.mark.parametrize("class_name", ["mouse", "can", "stapler"])
def test_a_planner_chosen_by_name_grasps_an_object_that_stands_alone(name, class_name, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    make_object(class_name, 0).visual_mesh().export(tmp_path / f"{class_name}.ply")
    models = [f"planner.models={tmp_path}"] if name == "model" else []
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("evaluate", overrides=["checkpoint=x", f"planner={name}", *models])
    planner = instantiate(OmegaConf.to_container(cfg.planner))
    points = np.asarray(make_object(class_name, 0).visual_mesh().sample(600, seed=0), float)
    points[:, 2] -= points[:, 2].min()
    plan = planner.plan(points, up=(0, 0, 1), table=(0, 0, 1, 0), obstacles=points + np.array([0.3, 0.0, 0.0]))
    assert plan.reason is None
    assert plan.best is not None
    rotation, middle = plan.best.pose[:3, :3], plan.best.pose[:3, 3]
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-6)
    assert rotation[2, 2] < -0.5  # from above
    # The object lies between the pads.
    local = (points - middle) @ rotation
    between = local[(np.abs(local[:, 1:]) < 0.015).all(axis=1), 0]
    assert 0 < plan.best.width <= ROBOTIQ_2F_140.stroke
    assert 0.01 < np.ptp(between) < plan.best.width + 0.02


@pytest.mark.parametrize("name", LEARNED)
def test_a_learned_planner_chosen_by_name_plans_with_its_networks(name, tmp_path):
    """Untrained ones: what they like says nothing, but what is planned has room and is between the pads."""
    overrides = ["checkpoint=x", f"planner={name}"]
    for setting, network in LEARNED[name].items():
        config = NetworkConfig(network, cloud_points=64, n_points=32, image_size=16)
        write_grasp_checkpoint(tmp_path / network, GraspCheckpoint(build_network(config), config, 0))
        overrides.append(f"planner.{setting}={tmp_path / network}")
    with initialize_config_dir(str(CONF), version_base="1.3"):
        planner = instantiate(compose("evaluate", overrides=overrides).planner)
    points = np.asarray(make_object("stapler", 0).visual_mesh().sample(600, seed=0), float)
    points[:, 2] -= points[:, 2].min()
    plan = planner.plan(points, up=(0, 0, 1), table=(0, 0, 1, 0), viewpoint=(0.3, 0, 0.6))
    if name == "graspnet":  # an untrained sampler's hands all come from below
        assert "hands" in plan.reason
        return
    assert plan.best is not None
    for grasp in plan.candidates:
        assert 0.0 <= grasp.score <= 1.0
        assert grasp.pose[2, 2] < -0.49
        local = (points - grasp.pose[:3, 3]) @ grasp.pose[:3, :3]
        between = (np.abs(local[:, 0]) < 0.07) & (np.abs(local[:, 1]) < 0.0135) & (local[:, 2] < 0.0325)
        assert 0.0 < grasp.width <= np.ptp(local[between, 0]) + 4e-3  # what is assumed of the back counts, too
