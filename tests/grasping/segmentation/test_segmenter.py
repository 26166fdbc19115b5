"""The segmenter on rendered scenes whose answer is known: boxes on a table, seen by a noisy camera."""

import warnings

import numpy as np
import pytest
from rendered_scenes import BOXES, look_down, owners_of, render, share_found, up_in

from grasping import CloudError, ConfigError, Segmenter


@pytest.mark.parametrize("tilt", [0.0, 25.0, 50.0])
@pytest.mark.parametrize("noise", [0.0, 0.0015])
def test_each_box_is_one_object_and_the_table_is_measured(tilt: float, noise: float) -> None:
    T = look_down(tilt)
    frame, owner = render(BOXES, T, noise)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert len(scene.objects) == 3
    assert scene.plane is not None
    assert scene.plane[:3] @ up_in(T) > np.cos(np.deg2rad(0.3))
    expected = -float(scene.plane[:3] @ (T[:3, :3].T @ -T[:3, 3]))
    assert scene.plane[3] == pytest.approx(expected, abs=0.001)
    for shares in owners_of(scene, owner):
        assert max(shares.values()) > 0.98
    assert all(share_found(scene, owner, box) > 0.85 for box in range(3))
    assert scene.touches_border == [False] * 3


def test_camera_frame_world_frame_and_a_loose_cloud_agree() -> None:
    T = look_down()
    frame, owner = render(BOXES, T)
    world = (frame.astype(np.float64) @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
    loose = frame.reshape(-1, 3)
    loose = loose[np.isfinite(loose).all(axis=1)]
    organised = Segmenter().segment(frame)
    for scene in (Segmenter().segment(world, up=(0, 0, 1)), Segmenter().segment(world), Segmenter().segment(loose)):
        assert len(scene.objects) == 3
        for a, b in zip(scene.objects, organised.objects, strict=True):
            assert len(a) == pytest.approx(len(b), rel=0.05)
    assert Segmenter().segment(world).plane[2] > 0.999
    for points, index in zip(organised.objects, organised.indices, strict=True):
        np.testing.assert_array_equal(points, frame.reshape(-1, 3)[index])
        assert points.dtype == np.float32
    assert [max(shares.values()) > 0.98 for shares in owners_of(organised, owner)] == [True] * 3


@pytest.mark.parametrize("noise", [0.001, 0.0015, 0.002])
def test_an_object_of_12_mm_survives_on_a_noisy_table(noise: float) -> None:
    T = look_down()
    frame, owner = render([(0.0, 0.0, 0.16, 0.015, 0.012)], T, noise)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert len(scene.objects) == 1
    assert share_found(scene, owner, 0) > 0.7
    assert owners_of(scene, owner)[0][0] > 0.9


@pytest.mark.parametrize("tilt", [0.0, 30.0])
def test_objects_3_cm_apart_are_two(tilt: float) -> None:
    T = look_down(tilt)
    frame, owner = render([(-0.04, 0.0, 0.05, 0.10, 0.05), (0.04, 0.0, 0.05, 0.10, 0.04)], T)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert len(scene.objects) == 2
    assert all(max(shares.values()) > 0.98 for shares in owners_of(scene, owner))


def test_an_object_whose_front_hides_its_middle_is_one() -> None:
    # A tall front, a low middle and a tall back, like a bowl's rims: from a low view the middle is unseen.
    T = look_down(60.0, 0.6)
    parts = [(0, -0.03, 0.08, 0.01, 0.05), (0, 0.0, 0.08, 0.05, 0.005), (0, 0.03, 0.08, 0.01, 0.05)]
    sides = [(-0.04, 0.0, 0.01, 0.07, 0.05), (0.04, 0.0, 0.01, 0.07, 0.05)]
    frame, _ = render(parts + sides, T)
    assert len(Segmenter().segment(frame, up=up_in(T)).objects) == 1


def test_an_object_at_the_edge_of_the_image_is_flagged() -> None:
    T = look_down(0.0)
    frame, owner = render([(0.0, 0.0, 0.06, 0.06, 0.05), (0.52, 0.0, 0.10, 0.06, 0.04)], T)
    scene = Segmenter().segment(frame, up=up_in(T))
    flags = {max(s, key=s.get): flag for s, flag in zip(owners_of(scene, owner), scene.touches_border, strict=True)}
    assert flags == {0: False, 1: True}


def test_a_plane_that_is_not_level_is_refused_and_said() -> None:
    T = look_down()
    frame, _ = render(BOXES, T)
    scene = Segmenter().segment(frame, up=T[:3, :3].T @ np.array([1.0, 0.0, 0.0]))
    assert scene.plane is None
    assert scene.rejected[0].what == "plane"
    assert scene.summary()


def test_the_face_of_a_box_is_no_table() -> None:
    frame, _ = render([(0.0, 0.0, 0.15, 0.10, 0.05)], look_down(0.0), table=False)
    scene = Segmenter().segment(frame)
    assert scene.plane is None
    assert "cm wide" in scene.rejected[0].why
    assert len(scene.objects) == 1


def test_the_floor_beside_a_table_is_not_taken_for_it() -> None:
    # The table is a board of 0.6 m, 0.5 m above a floor that fills the rest of the image.
    T = look_down(0.0, 0.55)
    board = (0.0, 0.0, 0.60, 0.40, 0.5, -0.5)
    below = T.copy()
    frame, owner = render([board, (0.0, 0.0, 0.08, 0.05, 0.06)], below, 0.001, table=False)
    floor, _ = render([], np.block([[T[:3, :3], T[:3, 3:] + [[0], [0], [0.5]]], [np.eye(4)[3:]]]), 0.001)
    frame = np.where(np.isfinite(frame), frame, floor)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert scene.plane is not None
    assert scene.plane[3] == pytest.approx(0.55, abs=0.003)
    assert len(scene.objects) == 1
    assert owners_of(scene, owner)[0][1] > 0.98


def test_what_stands_beside_the_table_is_an_obstacle_and_no_object() -> None:
    T = look_down(0.0, 0.8)
    board = (-0.2, 0.0, 0.60, 0.50, 0.02, -0.02)
    pillar = (0.40, 0.0, 0.08, 0.10, 0.5, -0.4)
    frame, owner = render([board, (-0.2, 0.0, 0.08, 0.05, 0.06), pillar], T, 0.001, table=False)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert [max(s, key=s.get) for s in owners_of(scene, owner)] == [1]
    assert any(entry.why == "beside the table" for entry in scene.rejected)
    assert len(scene.obstacles) == 1


def test_an_empty_table_has_no_objects_whatever_its_noise() -> None:
    T = look_down()
    for seed, noise in enumerate((0.0, 0.001, 0.002, 0.003)):
        frame, _ = render([], T, noise, seed)
        scene = Segmenter().segment(frame, up=up_in(T))
        assert scene.objects == []
        assert scene.plane is not None


def test_the_same_frame_gives_the_same_scene() -> None:
    T = look_down()
    frame, _ = render(BOXES, T)
    first, second = Segmenter().segment(frame), Segmenter().segment(frame)
    np.testing.assert_array_equal(first.plane, second.plane)
    for a, b in zip(first.indices, second.indices, strict=True):
        np.testing.assert_array_equal(a, b)


def test_published_parameters_lose_flat_objects_and_keep_the_others() -> None:
    T = look_down()
    tall = [(0.0, 0.0, 0.10, 0.05, 0.08), (0.20, 0.05, 0.06, 0.06, 0.10), (-0.2, 0.0, 0.16, 0.03, 0.012)]
    frame, owner = render(tall, T, 0.001)
    scene = Segmenter.published().segment(frame, up=up_in(T))
    assert sorted(max(s, key=s.get) for s in owners_of(scene, owner)) == [0, 1]
    assert len(Segmenter().segment(frame, up=up_in(T)).objects) == 3


@pytest.mark.parametrize(
    "cloud", [np.zeros((4, 4)), np.zeros((2, 2, 2, 3)), "cloud", [[None] * 3] * 3, np.ones((3, 3)) * 1j]
)
def test_what_is_no_cloud_is_refused(cloud: object) -> None:
    with pytest.raises(CloudError, match="cloud"):
        Segmenter().segment(cloud)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "cloud", [np.full((10, 10, 3), np.nan), np.zeros((10, 3)), np.ones((50, 3)) * 1e6, np.empty((0, 3))]
)
def test_a_frame_without_a_valid_point_in_range_is_refused(cloud: np.ndarray) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(CloudError, match="none of"):
            Segmenter().segment(cloud)


def test_odd_frames_end_in_a_scene_without_a_warning() -> None:
    rng = np.random.default_rng(0)
    few = np.full((240, 424, 3), np.nan, dtype=np.float32)
    few[100:103, 100:103] = rng.normal(size=(3, 3, 3)) * 0.01 + [0, 0, 0.5]
    huge = np.full((20, 20, 3), 3e38, dtype=np.float32)
    huge[5:9, 5:9] = rng.normal(loc=(0, 0, 1), size=(4, 4, 3))
    clouds = [few, huge, np.ones((100, 3)), np.linspace(0, 1, 200)[:, None] * [1, 1, 1], rng.normal(size=(500, 3))]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for cloud in clouds:
            for segmenter in (Segmenter(), Segmenter.published()):
                scene = segmenter.segment(cloud)
                assert len(scene.objects) == len(scene.touches_border) == len(scene.touches_gripper)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("depth_range", (1.0, 0.5)),
        ("plane_band", (0.01, 0.001)),
        ("plane_distance", 0.0),
        ("gap", float("nan")),
        ("min_points", 0),
        ("max_extent", -1.0),
    ],
)
def test_a_parameter_that_makes_no_sense_is_named(name: str, value: object) -> None:
    with pytest.raises(ConfigError, match=name):
        Segmenter(**{name: value})  # type: ignore[arg-type]
