"""The first system: a known object's whole model is planned on where it is found, and the cloud where it is not."""

from __future__ import annotations

import json

import numpy as np
import pytest
from mesh_shapes import bottle, box, join, moved, mug, write_ply

from grasping import ConfigError, CurvaturePlanner, ModelError, ModelPlanner, PoseEstimator
from grasping.pose.depth_image import depth_image
from grasping.pose.model_planner import told_class
from grasping.pose.object_model import object_model
from grasping.pose.outline import outline
from grasping.pose.pose_file import estimate_file

K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])


def looking_down(height: float, tilt: float = 60.0) -> np.ndarray:
    """T_camera_object (4, 4) of a thing upright on a table, 0.6 m before a camera that looks down at that angle."""
    s, c = np.sin(np.radians(tilt)), np.cos(np.radians(tilt))
    T = np.eye(4)
    T[:3, :3] = [[1, 0, 0], [0, -s, -c], [0, c, -s]]
    T[:3, 3] = 0.02, 0.03, 0.6
    return T


def seen(mesh, T: np.ndarray) -> np.ndarray:
    """The cloud (N, 3) that a camera without noise has of a mesh."""
    depth = depth_image(*mesh, T, K, (480, 640))
    v, u = np.nonzero(depth)
    z = depth[v, u]
    return np.stack([(u - 320) / 600 * z, (v - 240) / 600 * z, z], axis=1)


T = looking_down(0.09)
TABLE = np.append(T[:3, 2], 0.045 - T[:3, 2] @ T[:3, 3])  # the mug stands on it


@pytest.fixture(scope="module")
def cloud() -> np.ndarray:
    return seen(mug(), T)


@pytest.fixture(scope="module")
def planner() -> ModelPlanner:
    return ModelPlanner(models=[object_model(*mug(), "mug"), object_model(*bottle(), "bottle")])


def test_a_known_object_is_grasped_as_the_whole_that_it_is(planner, cloud):
    plan = planner.plan(cloud, table=TABLE, label="mug")
    assert plan.source.startswith("the model mug, on which")
    assert plan.best is plan.candidates[0]
    assert plan.best.terms["inlier_share"] > 0.9
    assert plan.best.terms["residual"] < 0.003
    assert plan.best.terms["assumed"] == 0  # nothing of the unseen back
    points = np.concatenate([region.points for region in plan.regions])
    local = (points - T[:3, 3]) @ T[:3, :3]
    assert local[:, 2].min() < -0.04  # its bottom, which no camera above a table sees
    tips = (plan.best.pose[:3, 3] - T[:3, 3]) @ T[:3, :3]
    assert np.linalg.norm(tips[:2]) < 0.09


def test_without_a_class_the_models_are_told_apart(planner, cloud):
    assert "the model mug" in planner.plan(cloud, table=TABLE).source


@pytest.mark.parametrize("label", ["bottle", "can"])
def test_where_no_model_is_found_the_cloud_is_planned_on_and_the_plan_says_why(planner, cloud, label):
    plan = planner.of_class(label).plan(cloud, table=TABLE)
    assert plan.source.startswith(ModelPlanner.FELL_BACK)
    assert label in plan.source
    alone = CurvaturePlanner().plan(cloud, table=TABLE)
    np.testing.assert_array_equal([g.pose for g in plan.candidates], [g.pose for g in alone.candidates])
    assert "inlier_share" not in plan.best.terms


def test_only_a_planner_with_models_is_told_the_class(planner, cloud):
    assert told_class(planner, "bottle").plan(cloud, table=TABLE).source.startswith("the cloud: ")
    assert told_class(planner, "mug").plan(cloud, table=TABLE).source.startswith("the model mug")
    without = CurvaturePlanner()
    assert told_class(without, "mug") is without


def test_what_is_seen_beside_the_model_is_in_the_way(planner, cloud):
    """Two posts, not told apart from the mug, on either side of where it would be held."""
    free = planner.plan(cloud, table=TABLE, label="mug").best
    sides = [free.pose[:3, 3] + sign * 0.055 * free.pose[:3, 0] for sign in (-1, 1)]
    ticks = np.linspace(-0.04, 0.02, 12)
    posts = np.concatenate([at + ticks[:, None] * T[:3, 2] for at in sides])
    plan = planner.plan(np.concatenate([cloud, posts]), table=TABLE, label="mug")
    assert plan.source.startswith("the model mug")
    for grasp in plan.candidates[:1]:
        local = (posts - grasp.pose[:3, 3]) @ grasp.pose[:3, :3]
        between = (np.abs(local[:, 1]) < 0.01) & (np.abs(local[:, 2]) < 0.01)
        assert not (between & (np.abs(local[:, 0]) < 0.5 * grasp.width)).any()


def test_no_models_and_settings_that_make_no_sense_are_refused(tmp_path):
    with pytest.raises(ModelError, match="none"):
        ModelPlanner(models=[])
    with pytest.raises(ModelError, match="is not a folder"):
        ModelPlanner(models=tmp_path / "nowhere")
    write_ply(tmp_path / "block.ply", box(0.05, 0.06, 0.07))
    with pytest.raises(ConfigError, match="friction"):
        ModelPlanner(models=tmp_path, friction=-1.0)


def test_the_outline_of_a_box_is_its_edges_that_are_seen():
    model = object_model(*box(0.06, 0.06, 0.06), "box", n_points=200)
    at = np.eye(4)
    at[:3, 3] = 0, 0, 0.5
    lines = outline(model, at, np.zeros(3)) - at[:3, 3]
    on = np.isclose(np.abs(lines), 0.03, atol=1e-9).sum(axis=1)
    assert (on >= 2).all()
    np.testing.assert_allclose(lines[:, 2], -0.03)  # from before its middle the front alone is seen
    assert len(lines) == 4 * 60


def test_a_file_gives_a_table_results_and_a_page(planner, cloud, tmp_path):
    np.save(tmp_path / "mug.npy", cloud.astype(np.float32))
    said: list[str] = []
    estimator = PoseEstimator(planner.models)
    results = estimate_file(tmp_path / "mug.npy", estimator, tmp_path / "out", say=said.append)
    assert json.loads((tmp_path / "out" / "results.json").read_text()) == results
    (pose,) = results["poses"]
    assert pose["model"] == "mug"
    np.testing.assert_allclose(np.array(pose["T_camera_object"])[:3, 3], T[:3, 3], atol=0.002)
    assert any(line.startswith("mug ") for line in said)
    page = (tmp_path / "out" / "poses.html").read_text()
    assert "mug, outline" in page
    assert "0 to 2 mm off" in page


def test_a_file_without_a_known_object_says_so(planner, tmp_path):
    at = looking_down(0.2)
    strange = seen(moved(join(box(0.15, 0.02, 0.02), box(0.02, 0.15, 0.02)), np.eye(4)), at)
    np.save(tmp_path / "cross.npy", strange.astype(np.float32))
    results = estimate_file(tmp_path / "cross.npy", PoseEstimator(planner.models), tmp_path / "out", say=lambda _: None)
    assert results["poses"] == []
    assert results["reason"]
    assert "No pose" in (tmp_path / "out" / "poses.html").read_text()
