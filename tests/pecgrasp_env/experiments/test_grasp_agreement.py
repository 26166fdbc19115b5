"""Grasps that hands alone have tried, tried again by the whole robot."""

from dataclasses import replace

import numpy as np

from pec.grasps.labels import GraspLabels
from pecgrasp_env.capture import CaptureConfig, ObjectsConfig, TabletopConfig
from pecgrasp_env.capture.grasps.config import GraspsConfig
from pecgrasp_env.capture.grasps.generate import generate_grasps
from pecgrasp_env.experiments.grasp_agreement import compare_with_arm, drawn_evenly


def test_the_whole_robot_lifts_what_a_hand_alone_held_and_not_what_it_missed(tmp_path):
    capture = CaptureConfig(
        scenario="tabletop",
        objects=ObjectsConfig(classes=("can",), instances_per_class=1),
        samples_per_instance=1,
        tabletop=TabletopConfig(objects_per_frame=1, drops=8),
        shard_size=1,
    )
    generate_grasps(GraspsConfig(capture, grasps_per_scene=8, cells=8), tmp_path, workers=1)
    (scene,) = GraspLabels(tmp_path).scenes()
    held = int(np.flatnonzero(scene.held & (scene.sampler == 0))[0])
    beside = scene.T_world_grasp.copy()
    beside[held, :2, 3] += 0.12 * beside[held, :2, 1]  # along the hinges: the fingers close beside it
    missing = replace(scene, T_world_grasp=beside)
    lifted, missed = compare_with_arm(tmp_path, [(scene, held), (missing, held)])
    assert (lifted.thing, lifted.alone, lifted.with_arm) == (scene.thing, "held", "lifted")
    assert missed.with_arm == "not lifted"


def test_of_each_outcome_equally_many_are_drawn_and_the_table_is_in_no_ones_way(tmp_path):
    capture = CaptureConfig(
        scenario="tabletop",
        objects=ObjectsConfig(classes=("box",), instances_per_class=1),
        samples_per_instance=1,
        tabletop=TabletopConfig(objects_per_frame=1, drops=8),
        shard_size=1,
    )
    generate_grasps(GraspsConfig(capture, grasps_per_scene=16, cells=16), tmp_path, workers=1)
    labels = GraspLabels(tmp_path)
    chosen = drawn_evenly(labels, 6)
    assert len(chosen) == 6
    outcomes = [labels.outcomes[scene.outcome[i]] for scene, i in chosen]
    assert 0 < outcomes.count("held") < 6
    lowest = [scene.T_world_grasp[i][2, 3] + 0.0325 * scene.T_world_grasp[i][2, 2] for scene, i in chosen]
    assert min(lowest) > 0
