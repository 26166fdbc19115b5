"""Objects come to rest, apart from each other, the same way for the same seed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sapien import physx
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects import make_object
from pecgrasp_env.scene.clutter import lay_out
from pecgrasp_env.scene.placement import PlacementError, Region, separation
from pecgrasp_env.scene.settling import settle

REGION = Region(0.33, 0.67, -0.25, 0.25)
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.fixture(scope="module")
def models():
    return [make_object(name, 1) for name in ("stapler", "mouse", "plug_adapter")]


def lowest(model, pose):
    points = np.concatenate(model.hulls)
    return (Rotation.from_quat(np.roll(pose[3:], -1)).apply(points)[:, 2] + pose[2]).min()


def test_what_falls_lies_on_the_table(models):
    poses = np.tile([0, 0, 0.15, 1.0, 0, 0, 0], (3, 1))
    poses[:, 0] = (0, 1, 2)
    ends, at_rest = settle(models, poses)
    assert at_rest.all()
    assert [lowest(model, pose) for model, pose in zip(models, ends, strict=True)] == pytest.approx([0, 0, 0], abs=2e-3)


def test_what_rests_stays(models):
    rng = np.random.default_rng(3)
    poses = lay_out(models, rng, REGION, clearance=0.03)
    ends, at_rest = settle(models, poses)
    assert at_rest.all()
    assert np.abs(ends[:, :3] - poses[:, :3]).max() < 1e-3


@pytest.mark.parametrize("seed", range(5))
def test_outlines_keep_their_clearance_and_the_region(models, seed):
    poses = lay_out(models, np.random.default_rng(seed), REGION, clearance=0.03)
    outlines = []
    for model, pose in zip(models, poses, strict=True):
        points = Rotation.from_quat(np.roll(pose[3:], -1)).apply(np.concatenate(model.hulls))[:, :2] + pose[:2]
        assert (points.min(axis=0) >= (REGION.x_min - 1e-9, REGION.y_min - 1e-9)).all()
        assert (points.max(axis=0) <= (REGION.x_max + 1e-9, REGION.y_max + 1e-9)).all()
        outlines.append(points)
    for i in range(3):
        for j in range(i):
            gaps = np.linalg.norm(outlines[i][:, None] - outlines[j][None], axis=2)
            assert gaps.min() >= 0.03


def test_the_generator_alone_decides(models):
    first, second = (lay_out(models, np.random.default_rng(7), REGION, clearance=0.02) for _ in range(2))
    other = lay_out(models, np.random.default_rng(8), REGION, clearance=0.02)
    assert np.array_equal(first, second)
    assert not np.allclose(first, other)


def test_objects_that_do_not_fit_are_named(models):
    with pytest.raises(PlacementError, match=r"stapler_0001.*clearance=0.5"):
        lay_out(models, np.random.default_rng(0), REGION, clearance=0.5)


@pytest.mark.parametrize(
    ("shift", "expected"), [((3.0, 0.0), 2.0), ((0.0, -1.5), 0.5), ((0.5, 0.0), -0.5), ((0.0, 0.0), -1.0)]
)
def test_separation_of_two_squares(shift, expected):
    assert separation(SQUARE, SQUARE + shift) == pytest.approx(expected)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 3.0), st.floats(-np.pi, np.pi))
def test_separation_is_symmetric_and_never_above_the_distance_of_vertices(seed, distance, heading):
    rng = np.random.default_rng(seed)
    a, b = (points[ConvexHull(points).vertices] for points in rng.normal(size=(2, 9, 2)))
    b = b + distance * np.array([np.cos(heading), np.sin(heading)])
    gap = separation(a, b)
    assert gap == pytest.approx(separation(b, a))
    assert gap <= np.linalg.norm(a[:, None] - b[None], axis=2).min() + 1e-9


def test_a_fall_does_not_depend_on_physics_settings_left_by_others():
    models = [make_object("stapler", 3)]
    pose = np.array([[0.0, 0.0, 0.15, 0.8, 0.3, 0.5, 0.1]])
    pose[0, 3:] /= np.linalg.norm(pose[0, 3:])
    ends, _ = settle(models, pose)
    before = physx.get_shape_config().contact_offset, physx.get_body_config().solver_position_iterations
    physx.set_shape_config(0.005, 0.0)
    physx.set_body_config(4, 0, 0.05)
    try:
        again, _ = settle(models, pose)
        assert physx.get_body_config().solver_position_iterations == 4
    finally:
        physx.set_shape_config(before[0], 0.0)
        physx.set_body_config(before[1], 1, 0.005)
    np.testing.assert_array_equal(again, ends)
