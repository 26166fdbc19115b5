"""Planners' first grasps: what is drawn, what a set of them holds, and what is counted of it."""

from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from grasping import CentroidPlanner
from pec.data.shards import Manifest, shard_name, write_manifest
from pec.grasps.labels import GraspLabels, GraspScene, write_grasp_shard
from pecgrasp_env.capture.grasps.config import GraspsConfig
from pecgrasp_env.capture.grasps.first_grasps import FirstGrasps
from pecgrasp_env.capture.grasps.generate import generate_grasps
from pecgrasp_env.experiments.tried_planners import compare_planners, plan_times_ms
from pecgrasp_env.objects import make_object

CONF = str(Path(__file__).parents[3] / "conf")
PLANNERS = {
    "default": {"_target_": "grasping.CurvaturePlanner"},
    "centroid": {"_target_": "grasping.CentroidPlanner"},
}


def scene(instance: str, outcomes: dict[int, int]) -> GraspScene:
    """Of the planners by number the outcomes of their grasps."""
    n = len(outcomes)
    codes = np.array(list(outcomes), np.uint8), np.array(list(outcomes.values()), np.uint8)
    rows = np.zeros((n, 4, 4), np.float32), np.zeros(n, np.float32), np.zeros(n, np.float32)
    return GraspScene("can", instance, np.random.default_rng(0).random((50, 3)), np.eye(4), np.eye(4), *rows, *codes)


@pytest.fixture
def labels(tmp_path) -> GraspLabels:
    """Three scenes of two cans: both hold, only the first holds, the second has no grasp."""
    scenes = [scene("a", {0: 0, 1: 0}), scene("a", {0: 0, 1: 2}), scene("b", {0: 1})]
    record = write_grasp_shard(tmp_path / shard_name(0, ".npz"), scenes)
    instances = [{"name": name, "class": "can"} for name in "ab"]
    config = {"samplers": list(PLANNERS), "outcomes": ["held", "lost in the shake", "not lifted"]}
    write_manifest(tmp_path, Manifest(["can"], instances, [], config, 0, {}, [record], complete=True))
    return GraspLabels(tmp_path)


def test_what_held_is_counted_by_planner_and_by_pair(labels) -> None:
    found = compare_planners(labels, "default")
    first, second = found["planners"].values()
    assert (first["held"], first["scenes"], second["held"]) == (2, 3, 1)
    assert first["outcomes"] == {"held": 2, "lost in the shake": 1, "not lifted": 0, "no grasp": 0}
    assert second["outcomes"] == {"held": 1, "lost in the shake": 0, "not lifted": 1, "no grasp": 1}
    low, high = first["interval_over_objects"]
    assert (low, high) == (0.0, 1.0)  # one can always, the other never
    (pair,) = found["comparisons"]
    assert pair == {
        "first": "default",
        "second": "centroid",
        "both": 1,
        "only_first": 1,
        "only_second": 0,
        "neither": 1,
        "p": 1.0,
    }


def test_a_plan_is_timed_for_each_planner(labels) -> None:
    times = plan_times_ms({"centroid": CentroidPlanner()}, list(labels.scenes()))
    assert times["centroid"] > 0


def test_each_planner_gives_its_first_grasp() -> None:
    can = make_object("can", 0)
    points = np.asarray(can.visual_mesh().sample(600, seed=0), float)
    points[:, 2] -= points[:, 2].min()
    drawn = FirstGrasps(PLANNERS).draw(can, np.eye(4), points, np.array([0.3, 0, 0.6]), 7, np.random.default_rng(0))
    assert drawn.sampler.tolist() == [0, 1]
    assert drawn.poses.shape == (2, 4, 4)
    assert (drawn.widths < drawn.openings).all()
    assert (drawn.openings <= 0.14).all()


def test_planners_are_tried_on_the_same_scenes(tmp_path) -> None:
    overrides = ["objects.classes=[can]", "instances_per_class=1", "scenes_per_instance=1"]
    overrides += ["+planner@planners.centroid=centroid", "free_views=0"]
    with initialize_config_dir(CONF, version_base="1.3"):
        settings = OmegaConf.to_container(compose("try_planners", overrides=overrides), resolve=True)
    config = GraspsConfig.from_settings(settings)
    assert config.grasps_per_scene == 2
    generate_grasps(config, tmp_path, workers=1)
    labels = GraspLabels(tmp_path)
    assert labels.samplers == ("default", "centroid")
    (tried,) = labels.scenes()
    assert tried.sampler.tolist() == [0, 1]
    assert compare_planners(labels, "default")["planners"]["default"]["held"] == 1
