from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from seen_stones import FLOOR, cut_out, frame_of, model_of, off, on_table, pose

from grasping.errors import CloudError, ConfigError, ModelError
from grasping.pose import kernels
from grasping.pose.pose_estimator import PoseEstimator
from grasping.segmentation.segmenter import Segmenter


def surface_off(model, T: np.ndarray, true: np.ndarray) -> float:
    """Mean distance of the model's points at the true pose to the nearest of those at T, m."""
    moved = [model.points @ M[:3, :3].T + M[:3, 3] for M in (T, true)]
    return float(cKDTree(moved[0]).query(moved[1])[0].mean())


@pytest.mark.parametrize("seed", range(6))
def test_a_stone_is_found_where_it_lies(seed: int) -> None:
    model, T = model_of("stone"), pose(seed)
    (found,) = PoseEstimator([model]).estimate(cut_out("stone", T))
    assert off(model, found.T_camera_object, T) < 0.004
    assert found.inlier_share > 0.8
    assert found.residual < 0.001
    assert not found.ambiguous


@settings(max_examples=5)
@given(st.integers(0, 10**6), st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_cloud_that_is_moved_has_its_pose_moved(seed: int, shift: tuple[float, float, float]) -> None:
    model, T = model_of("stone"), pose(2)
    cloud = cut_out("stone", T)
    M = pose(seed, shift)
    (found,) = PoseEstimator([model]).estimate(cloud @ M[:3, :3].T + M[:3, 3], viewpoint=M[:3, 3])
    assert off(model, found.T_camera_object, M @ T) < 0.002


def test_noise_and_a_hidden_third_move_it_by_little() -> None:
    model, T = model_of("stone"), pose(4)
    cloud = cut_out("stone", T)
    cloud = cloud[cloud[:, 0] > np.quantile(cloud[:, 0], 0.33)]
    cloud *= 1 + np.random.default_rng(0).normal(0, 0.002, len(cloud))[:, None]
    (found,) = PoseEstimator([model]).estimate(cloud)
    assert off(model, found.T_camera_object, T) < 0.006


def test_the_kernels_and_numpy_find_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    if kernels.compiled is None:
        pytest.skip("this installation has no compiled kernels")
    cloud = cut_out("stone", pose(5))
    models = [model_of("stone"), model_of("can")]
    (compiled,) = PoseEstimator(models).estimate(cloud)
    monkeypatch.setattr(kernels, "compiled", None)
    (reference,) = PoseEstimator(models).estimate(cloud)
    np.testing.assert_array_equal(compiled.T_camera_object, reference.T_camera_object)
    assert compiled.inlier_share == reference.inlier_share


def test_of_several_models_the_right_one_is_found() -> None:
    models = [model_of(name) for name in ("stone", "pebble", "box", "can")]
    estimator = PoseEstimator(models)
    for seed, model in enumerate(models):
        (found,) = estimator.estimate(cut_out(model.name, pose(seed + 20)))
        assert found.model is model
        assert surface_off(model, found.T_camera_object, pose(seed + 20)) < 0.005


def test_a_class_alone_is_found_as_by_an_estimator_of_its_own() -> None:
    stone, box = model_of("stone"), model_of("box")
    estimator = PoseEstimator([stone, box]).of_class(box.label)
    assert estimator.models == (box,)
    cloud = cut_out("box", pose(22))
    (found,), (own,) = estimator.estimate(cloud), PoseEstimator([box]).estimate(cloud)
    assert np.array_equal(found.T_camera_object, own.T_camera_object)
    with pytest.raises(ModelError, match="none"):
        estimator.of_class(stone.label)


def test_a_frame_gives_every_instance_and_leaves_strangers_out() -> None:
    things = [
        ("stone", on_table(1, -0.15, 0.02, 0.08)),
        ("stone", on_table(7, 0.0, 0.02, 0.08)),
        ("can", on_table(8, 0.15, 0.02, 0.07)),
    ]
    frame, _ = frame_of(things, FLOOR)
    stone = model_of("stone")
    found = PoseEstimator([stone]).estimate(frame, table=FLOOR)
    assert [each.model for each in found] == [stone, stone]
    for _, T in things[:2]:
        assert min(off(stone, each.T_camera_object, T) for each in found) < 0.003


def test_a_cut_out_of_two_touching_things_gives_both() -> None:
    stone, box = model_of("stone"), model_of("box")
    things = [("stone", pose(1, (-0.07, 0.0, 0.6))), ("box", pose(9, (0.07, 0.0, 0.6)))]
    points, owner = frame_of(things)
    found = PoseEstimator([stone, box]).estimate(points[owner >= 0])
    assert {each.model.name for each in found} == {"stone", "box"}
    for each in found:
        true = things[["stone", "box"].index(each.model.name)][1]
        assert surface_off(each.model, each.T_camera_object, true) < 0.005


def test_the_points_of_an_object_are_named() -> None:
    frame, owner = frame_of([("stone", pose(1, (-0.1, 0.0, 0.6))), ("can", pose(8, (0.1, 0.0, 0.6)))])
    (found,) = PoseEstimator([model_of("stone")]).estimate(frame, table=(0, -1, 0, 5))
    own = owner.reshape(-1)[found.indices] == 0
    assert own.mean() > 0.99
    assert own.sum() > 0.95 * (owner == 0).sum()


def test_a_scene_is_searched_with_its_table() -> None:
    T = on_table(1, 0.0, 0.02, 0.08)
    frame, _ = frame_of([("stone", T)], FLOOR)
    scene = Segmenter().segment(frame)
    (found,) = PoseEstimator([model_of("stone")]).estimate(scene)
    assert off(model_of("stone"), found.T_camera_object, T) < 0.003


@pytest.mark.parametrize(("shape", "known"), [("can", "stone"), ("box", "stone"), ("stone", "can"), ("can", "box")])
def test_a_stranger_gets_no_pose_and_a_reason(shape: str, known: str) -> None:
    estimator = PoseEstimator([model_of(known)])
    assert estimator.estimate(cut_out(shape, pose(3))) == []
    assert known in estimator.reason


def test_a_side_that_two_shapes_share_tells_neither() -> None:
    facing = np.eye(4)
    facing[2, 3] = 0.55
    side = cut_out("flat back", facing)
    np.testing.assert_allclose(side, cut_out("long back", facing))
    flat, long = model_of("flat back"), model_of("long back")
    (found,) = PoseEstimator([flat]).estimate(side)
    assert surface_off(flat, found.T_camera_object, facing) < 0.003
    both = PoseEstimator([flat, long])
    assert both.estimate(side) == []
    for words in ("another shape", flat.name, long.name):
        assert words in both.reason


def test_what_is_no_larger_than_the_noise_gets_no_pose() -> None:
    estimator = PoseEstimator([model_of("stone")])
    far = cut_out("stone", pose(1, (0.0, 0.0, 1.9)), focal=900.0)
    assert len(far) > 200
    assert estimator.estimate(far) == []
    assert "too small" in estimator.reason


def test_a_thing_that_was_cut_in_two_is_found_once_and_has_all_its_points() -> None:
    T = on_table(1, 0.0, 0.02, 0.08)
    frame, _ = frame_of([("stone", T)], FLOOR)
    scene = Segmenter().segment(frame)
    (whole,) = scene.indices
    left = frame.reshape(-1, 3)[whole][:, 0] < np.median(frame.reshape(-1, 3)[whole][:, 0]) + 0.015
    pieces = [whole[left], whole[~left]]
    cut = replace(scene, objects=[frame.reshape(-1, 3)[each] for each in pieces], indices=pieces)
    (found,) = PoseEstimator([model_of("stone")]).estimate(cut)
    assert off(model_of("stone"), found.T_camera_object, T) < 0.004
    assert set(found.indices) == set(whole)


def test_a_symmetric_thing_says_so() -> None:
    (found,) = PoseEstimator([model_of("can")]).estimate(cut_out("can", pose(6)))
    assert found.ambiguous
    assert "any turn about its" in str(found.ambiguous)
    assert len(found.ambiguous.others) == 0


def test_two_models_of_one_shape_are_named() -> None:
    stone = model_of("stone")
    (found,) = PoseEstimator([stone, replace(stone, name="twin")]).estimate(cut_out("stone", pose(2)))
    assert {found.model.name, *found.ambiguous.models} == {"stone", "twin"}
    assert "it may be" in str(found.ambiguous)


def test_proposals_are_aligned_and_checked() -> None:
    model, T = model_of("stone"), pose(2)
    near = T.copy()
    near[:3, :3] = T[:3, :3] @ Rotation.from_rotvec([0.1, -0.1, 0.05]).as_matrix()
    near[:3, 3] += 0.005
    estimator = PoseEstimator([model])
    cloud = cut_out("stone", T)
    found = estimator.refine(cloud, model, [pose(9), near])
    assert found is not None
    assert off(model, found.T_camera_object, T) < 0.002
    assert estimator.refine(cloud, model, [pose(9, (0.3, 0.0, 0.6))]) is None
    assert estimator.reason


@pytest.mark.parametrize("count", [0, 20])
def test_too_few_points_give_no_pose(count: int) -> None:
    estimator = PoseEstimator([model_of("stone")])
    assert estimator.estimate(cut_out("stone", pose(0))[:count]) == []
    assert f"{count} points" in estimator.reason


def test_what_is_no_cloud_or_no_model_is_refused() -> None:
    model = model_of("stone")
    cloud = cut_out("stone", pose(0))
    with pytest.raises(ModelError, match="none"):
        PoseEstimator([])
    with pytest.raises(ModelError, match="'stone'"):
        PoseEstimator([model, model])
    estimator = PoseEstimator([model])
    with pytest.raises(CloudError, match="not finite"):
        estimator.estimate(np.where(np.arange(len(cloud))[:, None] == 5, np.nan, cloud))
    with pytest.raises(CloudError, match="millimetres"):
        estimator.estimate(1000 * cloud)
    with pytest.raises(CloudError, match="shape"):
        estimator.estimate(cloud[:, :2])
    with pytest.raises(ConfigError, match="viewpoint"):
        estimator.estimate(cloud, viewpoint=[0, np.nan, 0])
    with pytest.raises(ConfigError, match="table"):
        estimator.estimate(cloud, table=[0, 0, 0, 1])
    with pytest.raises(ConfigError, match="proposals"):
        estimator.refine(cloud, model, np.eye(4))
    with pytest.raises(ConfigError, match="can"):
        estimator.refine(cloud, model_of("can"), [np.eye(4)])


@pytest.mark.parametrize("cloud", [np.zeros((100, 3)), np.full((100, 3), 0.5)])
def test_points_that_coincide_give_no_pose(cloud: np.ndarray) -> None:
    estimator = PoseEstimator([model_of("stone")])
    assert estimator.estimate(cloud) == []
    assert estimator.reason
