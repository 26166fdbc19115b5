"""Fusing views whose true poses are known: boxes with handles, cylinders and balls, seen by a noisy camera."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seen_shapes import ball, box, box_with_handle, camera, cylinder, jolt, off, seen, views_of

from grasping import CloudError, ConfigError, Fused, fuse
from grasping.fusion.icp import Alignment, moved
from grasping.geometry.voxel_grid import cube_means, cubes

VOXEL = 0.002  # m, the default


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("posed", [True, False])
def test_a_small_motion_is_undone_exactly_where_there_is_no_noise(seed: int, posed: bool) -> None:
    clouds, poses, rough = views_of(box_with_handle, seed, 0.0, (0.3, 0.9))
    if posed:
        fused = fuse(clouds, poses=rough)
        change = fused.views[1].T_common_view @ np.linalg.inv(poses[1])
    else:  # the views are in one frame already, but for an error
        error = jolt(np.random.default_rng(seed))
        fused = fuse([moved(poses[0], clouds[0]), moved(error @ poses[1], clouds[1])])
        change = fused.views[1].T_common_view @ error
    assert fused.kept == [0, 1]
    assert np.linalg.norm(change[:3, 3]) < 1e-4
    assert Rotation.from_matrix(change[:3, :3]).magnitude() < np.radians(0.1)


@pytest.mark.parametrize("seed", range(6))
def test_three_noisy_views_with_rough_poses_lie_within_two_millimetres(seed: int) -> None:
    clouds, poses, rough = views_of(box_with_handle, seed, 0.001)
    fused = fuse(clouds, poses=rough)
    assert fused.kept == [0, 1, 2]
    for cloud, T, start, view in zip(clouds[1:], poses[1:], rough[1:], fused.views[1:], strict=True):
        assert off(view.T_common_view, T, cloud) < 0.002 < off(start, T, cloud)
        assert view.overlap > 0.5
        assert 0.0003 < view.rmse < 0.0015
    np.testing.assert_array_equal(fused.views[0].T_common_view, rough[0])


def test_outliers_do_not_pull() -> None:
    clouds, poses, rough = views_of(box_with_handle, 0, 0.001, (0.3, 1.1))
    rng = np.random.default_rng(1)
    stray = rng.uniform(-0.08, 0.08, (len(clouds[1]) // 5, 3)) + np.array([0, 0, 0.5])
    fused = fuse([clouds[0], np.vstack([clouds[1], stray])], poses=rough)
    assert off(fused.views[1].T_common_view, poses[1], clouds[1]) < 0.002


@pytest.mark.parametrize("seed", range(4))
def test_a_cylinder_is_moved_onto_itself_but_not_turned_about_its_axis(seed: int) -> None:
    clouds, poses, rough = views_of(cylinder, seed, 0.001, (0.3, 1.0))
    fused = fuse(clouds, poses=rough)
    view = fused.views[1]
    assert view.reason is None
    assert len(view.free) == 1
    assert "turn about" in view.free[0]
    assert "keeps its rough pose" in fused.summary()
    # The axis is where it belongs …
    change = view.T_common_view @ np.linalg.inv(poses[1])
    assert np.degrees(np.arccos(change[2, 2])) < 0.5
    assert np.abs(change[:3, 3]).max() < 0.0015
    # … and the turn about it is the rough pose's own error.
    rough_change = rough[1] @ np.linalg.inv(poses[1])
    about_axis = [Rotation.from_matrix(T[:3, :3]).as_rotvec()[2] for T in (change, rough_change)]
    assert about_axis[0] == pytest.approx(about_axis[1], abs=np.radians(0.5))


def test_a_ball_is_shifted_and_not_turned_at_all() -> None:
    clouds, poses, rough = views_of(ball, 0, 0.001, (0.3, 1.0))
    view = fuse(clouds, poses=rough).views[1]
    assert len(view.free) == 3
    assert view.turn < np.radians(0.1)
    assert (
        np.linalg.norm(view.T_common_view[:3, 3] + view.T_common_view[:3, :3] @ np.linalg.inv(poses[1])[:3, 3]) < 1e-3
    )


def test_what_slid_along_a_free_motion_is_measured() -> None:
    # A cylinder about z through (0, 0, 0.5): the turn about z and, seen from its middle, the shift along z are free.
    free = np.array([[0, 0, 1.0, 0, 0, 0], [0, 0, 0, 0, 0, 1.0]])
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("z", 0.2).as_matrix()
    T[:3, 3] = [0.004, 0.0, 0.003]
    centre = moved(T, np.array([[0.0, 0.0, 0.5]]))[0]
    shift, turn, slid = Alignment(T, 1.0, 0.0, free, centre, 0.05).departure(np.eye(4))
    assert shift == pytest.approx(0.005)
    assert turn == pytest.approx(0.2)
    assert slid == pytest.approx(np.hypot(0.2 * 0.05, 0.003))


def test_a_view_that_does_not_overlap_is_left_out_and_said() -> None:
    clouds, poses, rough = views_of(box_with_handle, 0, 0.001, (0.3, 1.1))
    elsewhere = rough[1].copy()
    elsewhere[0, 3] += 0.3
    fused = fuse(clouds, poses=[rough[0], elsewhere])
    assert fused.kept == [0]
    assert "% of its points lie within 10 mm" in str(fused.views[1].reason)
    assert "view 1 left out" in fused.summary()
    np.testing.assert_array_equal(fused.views[1].T_common_view, elsewhere)
    first = moved(poses[0], clouds[0])
    np.testing.assert_allclose(fused.points, cube_means(first, cubes(first, VOXEL)))


def test_a_view_that_would_leave_its_rough_pose_is_left_out_and_said() -> None:
    clouds, _, rough = views_of(box_with_handle, 0, 0.001, (0.3, 1.1))
    fused = fuse(clouds, poses=rough, max_shift=0.001)
    assert fused.kept == [0]
    assert "from its rough pose" in str(fused.views[1].reason)


def test_another_object_does_not_fit() -> None:
    clouds, _, rough = views_of(box_with_handle, 0, 0.001, (0.3, 1.1))
    other = views_of(ball, 0, 0.001, (0.3, 1.1))[0][1]
    fused = fuse([clouds[0], other], poses=rough)
    assert fused.kept == [0]
    assert fused.views[1].reason


def test_a_view_waits_for_the_one_that_joins_it_to_the_first() -> None:
    # A bar of 0.4 m seen piece by piece: the last piece touches only the middle one.
    rng = np.random.default_rng(0)
    bar = np.vstack(
        [
            box(9000, (0.4, 0.03, 0.03), rng)[0],
            *[box(300, (0.01, 0.05, 0.05), rng, (x, 0, 0))[0] for x in np.linspace(-0.19, 0.19, 9)],
        ]
    )
    left, middle, right = (bar[np.abs(bar[:, 0] - x) < 0.1] for x in (-0.1, 0.0, 0.1))
    fused = fuse([left, moved(jolt(rng, 0.004, 1.0), right), middle])
    assert fused.kept == [0, 1, 2]
    assert np.ptp(fused.points[:, 0]) == pytest.approx(0.4, abs=0.002)


@pytest.mark.parametrize("known", [True, False])
def test_the_table_is_taken_off_whatever_the_error_of_the_pose(known: bool) -> None:
    clouds, poses, rough = views_of(box_with_handle, 1, 0.001, (0.3, 1.1))
    rng = np.random.default_rng(2)
    flat = np.column_stack([rng.uniform(-0.3, 0.3, (30_000, 2)), np.full(30_000, -0.04)])
    hidden = (np.abs(flat[:, 0]) < 0.1) & (np.abs(flat[:, 1]) < 0.06)
    scenes = [
        np.vstack([c, seen((flat[~hidden], flat[~hidden] * 0 + [0, 0, 1]), T, rng, 0.001)])
        for c, T in zip(clouds, poses, strict=True)
    ]
    fused = fuse(scenes, poses=rough, table=(0, 0, 1, 0.04) if known else "find")
    assert fused.kept == [0, 1]
    assert off(fused.views[1].T_common_view, poses[1], clouds[1]) < 0.003
    assert fused.points[:, 2].min() > -0.04
    assert np.abs(fused.points[:, :2]).max() < 0.15


def test_a_view_without_the_table_that_it_should_show_is_left_out() -> None:
    clouds, _, rough = views_of(ball, 0, 0.001, (0.3, 1.1))
    fused = fuse(clouds, poses=rough, table="find")
    assert fused.kept == []
    assert fused.points.shape == (0, 3)
    assert all("table was not found" in str(view.reason) for view in fused.views)


def test_the_frame_that_the_poses_lead_to_makes_no_difference_and_neither_does_the_run() -> None:
    clouds, _, rough = views_of(box_with_handle, 3, 0.001)
    T = jolt(np.random.default_rng(9), 1.0, 170.0)
    first, again, elsewhere = (fuse(clouds, poses=poses) for poses in (rough, rough, [T @ pose for pose in rough]))
    np.testing.assert_array_equal(first.points, again.points)
    for a, b in zip(first.views, elsewhere.views, strict=True):
        np.testing.assert_allclose(T @ a.T_common_view, b.T_common_view, atol=2e-4)


def test_organised_frames_and_float32_will_do() -> None:
    clouds, poses, rough = views_of(box_with_handle, 0, 0.001, (0.3, 1.1))
    frames = []
    for cloud in clouds:
        frame = np.full((60 * 60, 3), np.nan, dtype=np.float32)
        frame[: len(cloud)] = cloud[:3600]
        frames.append(frame.reshape(60, 60, 3))
    fused = fuse(frames, poses=rough)
    assert off(fused.views[1].T_common_view, poses[1], clouds[1]) < 0.002


def test_odd_views_are_left_out_without_a_warning() -> None:
    rng = np.random.default_rng(0)
    good = moved(camera(0.3), seen(box_with_handle(rng), camera(0.3), rng))
    line = np.linspace(0, 0.1, 500)[:, None] * [1.0, 0, 0]
    odd = [np.ones((500, 3)), line, good[:5], np.zeros((1, 3)) + 0.5, rng.normal(size=(300, 3)) * 0.03]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for cloud in odd:
            fused = fuse([good, cloud])
            assert isinstance(fused, Fused)
            assert 0 in fused.kept
            assert np.isfinite(fused.points).all()
            fuse([cloud, cloud])
            fuse([cloud, good])
        alone = fuse([good])
    assert alone.kept == [0]
    assert "fit" in alone.summary()


GOOD = np.random.default_rng(0).uniform(-0.05, 0.05, (500, 3))
TURNED = np.diag([1.0, 1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    "cloud", [np.zeros((4, 4)), "cloud", np.full((9, 3), np.nan), np.empty((0, 3)), GOOD * 1e3, [[None] * 3] * 3]
)
def test_a_view_that_is_no_cloud_of_an_object_is_named(cloud: object) -> None:
    with pytest.raises(CloudError, match=r"views\[1\]"):
        fuse([GOOD, cloud])  # type: ignore[list-item]


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"poses": [np.eye(4)]}, "poses: 1 of them for 2"),
        ({"poses": [np.eye(4), np.eye(3)]}, r"poses\[1\]"),
        ({"poses": [np.eye(4), TURNED]}, r"poses\[1\]"),
        ({"poses": [np.eye(4) * np.nan, np.eye(4)]}, r"poses\[0\]"),
        ({"poses": [np.eye(4), 2 * np.eye(4)]}, r"poses\[1\]"),
        ({"poses": [np.eye(4), "here"]}, r"poses\[1\]"),
        ({"table": "seek"}, "table"),
        ({"table": (0, 0, 0, 1)}, "table"),
        ({"voxel": 0.0}, "voxel"),
        ({"distance": np.nan}, "distance"),
        ({"iterations": 0}, "iterations"),
        ({"max_shift": -1.0}, "max_shift"),
        ({"max_turn": 4.0}, "max_turn"),
    ],
)
def test_an_argument_that_makes_no_sense_is_named(arguments: dict, match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        fuse([GOOD, GOOD], **arguments)


def test_no_views_are_refused() -> None:
    with pytest.raises(ConfigError, match="views"):
        fuse([])
