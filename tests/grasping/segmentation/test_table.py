"""What the segmenter takes for the table and what not, in every frame of reference, and what becomes of each point."""

import numpy as np
import pytest
from rendered_scenes import BOXES, look_down, owners_of, render, share_found, up_in
from scipy.spatial.transform import Rotation

from grasping import Scene, Segmenter

UP = np.array([0.0, 0.0, 1.0])


def rigid(seed: int) -> np.ndarray:
    """Any rotation, and a shift of up to half a metre."""
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    T[:3, 3] = np.random.default_rng(seed).uniform(-0.3, 0.3, 3)
    return T


def moved(T: np.ndarray, frame: np.ndarray) -> np.ndarray:
    return (frame @ T[:3, :3].T + T[:3, 3]).astype(frame.dtype)


def counted(scene: Scene) -> int:
    """Points of the objects, of the table, and of what was rejected."""
    rejected = sum(entry.n_points for entry in scene.rejected if entry.what != "plane")
    return sum(len(points) for points in scene.objects) + scene.n_table + rejected


@pytest.mark.parametrize("distance", [0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
@pytest.mark.parametrize("tilt", [0.0, 25.0])
def test_a_wire_cutter_of_12_mm_survives_at_every_working_distance(distance: float, tilt: float) -> None:
    # Two handles and a head; 0.9 mm of noise at 0.6 m, growing with the square, is a D435's at 848 pixels.
    T = look_down(tilt, distance)
    cutter = [(0.0, 0.011, 0.11, 0.014, 0.012), (0.0, -0.011, 0.11, 0.014, 0.012), (0.075, 0.0, 0.04, 0.03, 0.012)]
    for seed in range(3):
        frame, owner = render(cutter, T, 0.0009, seed)
        scene = Segmenter().segment(frame, up=up_in(T))
        assert len(scene.objects) == 1
        owner = np.where(owner >= 0, 0, -1)
        assert share_found(scene, owner, 0) > 0.75
        assert owners_of(scene, owner)[0][0] > 0.85


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("organised", [True, False])
@pytest.mark.parametrize("told", ["up", "nothing"])
def test_the_same_objects_in_any_frame_organised_or_loose(seed: int, organised: bool, told: str) -> None:
    T = look_down()
    frame, _ = render(BOXES, T, 0.001, seed)
    expected = Segmenter().segment(frame, up=up_in(T))
    # Without being told where up is, the camera must be at the frame's origin: only a turn keeps it there.
    change = rigid(seed)
    if told == "nothing":
        change[:3, 3] = 0.0
    cloud = moved(change, frame)
    chosen = np.arange(cloud[..., 0].size)
    if not organised:
        chosen = np.random.default_rng(seed).permutation(np.flatnonzero(np.isfinite(cloud).all(axis=2)))
        cloud = cloud.reshape(-1, 3)[chosen]
    up = change[:3, :3] @ up_in(T) if told == "up" else None
    scene = Segmenter().segment(cloud, up=up)
    assert len(scene.objects) == len(expected.objects) == len(BOXES)
    for index in expected.indices:
        shared = [
            len(np.intersect1d(chosen[other], index)) / len(np.union1d(chosen[other], index)) for other in scene.indices
        ]
        assert max(shared) > 0.95
    assert scene.plane is not None
    np.testing.assert_allclose(scene.plane[:3] @ change[:3, :3], expected.plane[:3], atol=2e-3)


def test_every_point_is_in_an_object_in_the_table_or_rejected_with_a_reason() -> None:
    T = look_down(30.0, 0.6)
    frame, _ = render([*BOXES, (0.1, -0.12, 0.01, 0.01, 0.004)], T, 0.002)
    frame = frame[::2, ::2].copy()
    frame[:20, :50] = np.nan
    frame[30:34, 60:64] = 0.0
    frame[40:43, 60:63] *= 9.0
    for segmenter in (Segmenter(max_height=0.05), Segmenter.published()):
        for cloud in (frame, frame.reshape(-1, 3), frame[..., ::-1].astype(np.float64)):
            for up in (up_in(T), None, up_in(T)[::-1], T[:3, :3].T @ [1.0, 0.0, 0.0]):
                scene = segmenter.segment(cloud, up=up)
                assert counted(scene) == frame[..., 0].size
                assert all(entry.why and entry.n_points > 0 for entry in scene.rejected)
                assert len(np.unique(np.concatenate([[], *scene.indices]))) == sum(map(len, scene.indices))
    reasons = Segmenter(max_height=0.05).segment(frame, up=up_in(T)).summary()
    assert "no depth" in reasons
    assert "above the table" in reasons
    assert "m away" in reasons


def test_the_plane_is_fitted_to_all_of_its_points() -> None:
    # Of 100,000 points with 2 mm of noise the mean is known to 10 µm; of the RANSAC's sample only to 40 µm.
    T = look_down(0.0)
    off = []
    for seed in range(8):
        frame, _ = render([], T, 0.002, seed)
        plane = Segmenter(seed=seed).segment(frame, up=up_in(T)).plane
        off.append(plane[3] + plane[:3] @ [0.0, 0.0, 0.55])
    assert np.abs(off).max() < 4e-5


def test_a_wall_that_fills_more_of_the_view_is_not_the_table() -> None:
    T = look_down(60.0, 0.5)
    wall = (0.0, 0.10, 2.0, 0.02, 2.0)
    frame, owner = render([(0.0, 0.20, 0.06, 0.04, 0.03), wall], T, 0.001)
    assert (owner == 1).sum() > 1.2 * (owner == -1).sum()
    scene = Segmenter().segment(frame, up=up_in(T))
    assert scene.plane is not None
    assert scene.plane[:3] @ up_in(T) > 0.999
    assert [max(shares, key=shares.get) for shares in owners_of(scene, owner)] == [0]
    assert any("m large" in entry.why for entry in scene.rejected)


def test_a_wall_alone_is_refused_in_words() -> None:
    T = look_down(90.0, 0.6)
    frame, _ = render([(0.0, 0.0, 4.0, 0.02, 4.0, -2.0)], T, 0.001, table=False)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert scene.plane is None
    assert scene.objects == []
    assert scene.rejected[0].what == "plane"
    assert scene.rejected[0].why


def test_the_lid_of_a_box_that_fills_the_view_is_not_the_table() -> None:
    T = look_down(0.0, 0.45)
    frame, owner = render([(0.0, 0.0, 0.36, 0.28, 0.12)], T, 0.001)
    assert (owner == 0).mean() > 0.4 > 0.15 < (owner == -1).mean()
    scene = Segmenter().segment(frame, up=up_in(T))
    assert scene.plane is not None
    assert scene.plane[3] == pytest.approx(0.45, abs=0.002)
    assert len(scene.objects) == 1
    assert share_found(scene, owner, 0) > 0.95


def test_where_there_is_no_table_the_objects_are_told_apart_in_space_and_the_reason_is_given() -> None:
    frame, owner = render([(-0.06, 0.0, 0.06, 0.06, 0.05), (0.06, 0.0, 0.06, 0.06, 0.05)], look_down(0.0), table=False)
    scene = Segmenter().segment(frame)
    assert scene.plane is None
    assert scene.n_table == 0
    assert len(scene.objects) == 2
    assert all(max(shares.values()) == 1.0 for shares in owners_of(scene, owner))
    assert scene.summary().startswith("a plane of")


def test_points_that_hang_between_an_edge_and_the_table_belong_to_nothing() -> None:
    T = look_down(0.0)
    frame, owner = render([(0.0, 0.0, 0.08, 0.06, 0.12)], T, 0.0005)
    inner = owner == 0
    edge = inner & ~(np.roll(inner, 1, 1) & np.roll(inner, -1, 1) & np.roll(inner, 1, 0) & np.roll(inner, -1, 0))
    flying = edge & (np.indices(edge.shape).sum(axis=0) % 4 == 0)
    frame[flying] *= (1 + np.random.default_rng(0).uniform(0.08, 0.2, flying.sum()))[:, None].astype(np.float32)
    scene = Segmenter().segment(frame, up=up_in(T))
    assert len(scene.objects) == 1
    hanging = np.flatnonzero(flying.reshape(-1))
    assert np.isin(hanging, scene.indices[0]).mean() < 0.1
    noted = [entry.n_points for entry in scene.rejected if entry.why == "in the air at an edge"]
    assert noted[0] > 0.8 * len(hanging)
    assert share_found(scene, np.where(flying, -1, owner), 0) > 0.97
