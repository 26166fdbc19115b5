"""Where the camera stood, and what of each object's surroundings it did not measure."""

import numpy as np
import pytest
from rendered_scenes import BOXES, FOCAL, HEIGHT, WIDTH, look_down, render, up_in

from grasping import ConfigError, Segmenter
from grasping.segmentation.lines_of_sight import LinesOfSight


def holed(tilt: float = 25.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A box with a hole in the middle of its picture, the hole's mask, and T_world_camera."""
    T = look_down(tilt)
    frame, owner = render([(0.0, 0.0, 0.12, 0.08, 0.08)], T, 0.0)
    rows, columns = np.nonzero(owner == 0)
    hole = np.zeros(owner.shape, dtype=bool)
    hole[int(rows.mean()) - 4 : int(rows.mean()) + 5, int(columns.mean()) - 6 : int(columns.mean()) + 7] = True
    frame[hole] = np.nan
    return frame, hole, T


def test_a_hole_in_an_object_is_unseen_along_its_pixels_lines_down_to_the_table() -> None:
    frame, hole, T = holed()
    scene = Segmenter().segment(frame, up=up_in(T))
    assert len(scene.objects) == len(scene.unseen) == 1
    np.testing.assert_array_equal(scene.viewpoint, np.zeros(3))
    rows, columns = np.nonzero(hole)
    rays = np.stack(
        [(columns + 0.5 - WIDTH / 2) / FOCAL, (rows + 0.5 - HEIGHT / 2) / FOCAL, np.ones(len(rows))], axis=1
    )
    world = rays @ T[:3, :3].T
    expected = rays * (-T[2, 3] / world[:, 2])[:, None]
    np.testing.assert_allclose(scene.unseen[0], expected, atol=1e-3)


def test_the_same_in_the_worlds_frame_where_the_viewpoint_is_told() -> None:
    frame, hole, T = holed()
    world = (frame @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
    told = Segmenter().segment(world, up=(0, 0, 1), viewpoint=T[:3, 3])
    np.testing.assert_allclose(told.viewpoint, T[:3, 3])
    assert len(told.unseen[0]) == hole.sum()
    np.testing.assert_allclose(told.unseen[0][:, 2], 0.0, atol=1e-3)
    for up in ((0, 0, 1), None):
        untold = Segmenter().segment(world, up=up)
        assert untold.viewpoint is None  # its origin lies in the table
        assert [len(each) for each in untold.unseen] == [0]


def test_an_origin_above_the_table_that_the_pixels_do_not_look_from_is_no_viewpoint() -> None:
    frame, _, T = holed()
    world = (frame @ T[:3, :3].T + T[:3, 3] - [0.4, 0.0, 0.6]).astype(np.float32)
    scene = Segmenter().segment(world, up=(0, 0, 1))
    assert scene.viewpoint is None
    assert len(scene.objects) == 1


def test_a_hole_away_from_objects_belongs_to_none_and_one_beside_an_object_to_it() -> None:
    T = look_down(0.0)
    frame, owner = render(BOXES, T, 0.0)
    assert [len(each) for each in Segmenter().segment(frame, up=up_in(T)).unseen] == [0, 0, 0]
    frame[:10] = np.nan
    columns = np.flatnonzero((owner == 0).any(axis=0))
    rows = np.flatnonzero((owner == 0).any(axis=1))
    frame[rows[0] : rows[-1] + 1, columns[-1] + 1 : columns[-1] + 4] = np.nan
    scene = Segmenter().segment(frame, up=up_in(T))
    counts = {
        int(owner.reshape(-1)[index[0]]): len(far) for index, far in zip(scene.indices, scene.unseen, strict=True)
    }
    assert counts == {0: 3 * len(rows), 1: 0, 2: 0}


def test_without_a_table_the_lines_end_where_the_object_does() -> None:
    frame, _ = render([(0.0, 0.0, 0.10, 0.08, 0.05)], look_down(0.0), table=False, noise=0.0)
    frame[110:125, 200:220] = np.nan
    scene = Segmenter().segment(frame)
    assert scene.plane is None
    farthest = np.linalg.norm(scene.objects[0], axis=1).max()
    np.testing.assert_allclose(np.linalg.norm(scene.unseen[0], axis=1), farthest, rtol=1e-5)


def test_a_loose_cloud_and_one_of_one_row_or_column_have_no_holes_and_no_edge() -> None:
    frame, _, _ = holed()
    points = frame.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    expected = Segmenter().segment(points)
    for shape in ((-1, 1, 3), (1, -1, 3)):
        scene = Segmenter().segment(points.reshape(shape))
        assert [len(each) for each in scene.objects] == [len(each) for each in expected.objects]
        assert scene.rejected == expected.rejected
        assert scene.touches_border == [False]
        assert [each.shape for each in scene.unseen] == [(0, 3)]
        np.testing.assert_array_equal(scene.viewpoint, np.zeros(3))


@pytest.mark.parametrize("viewpoint", [(0, 0), "here", (np.nan, 0, 0)])
def test_a_viewpoint_without_sense_is_refused_by_name(viewpoint: object) -> None:
    with pytest.raises(ConfigError, match="viewpoint"):
        Segmenter().segment(holed()[0], viewpoint=viewpoint)  # type: ignore[arg-type]


def test_a_frame_that_a_table_fills_says_by_what_stands_on_it_from_where_it_was_seen() -> None:
    T = look_down(0.0)
    frame, _ = render([(0.0, 0.0, 0.05, 0.05, 0.05), (0.2, 0.1, 0.04, 0.04, 0.06)], T, 0.0)
    points = frame.reshape(-1, 3)
    valid = np.isfinite(points).all(axis=1)
    assert LinesOfSight(points, valid, frame.shape[:2], np.zeros(3)).fits
    world = points @ T[:3, :3].T + T[:3, 3] - [0.5, 0.0, 0.0]
    assert not LinesOfSight(world, valid, frame.shape[:2], np.zeros(3)).fits
    assert LinesOfSight(world, valid, frame.shape[:2], T[:3, 3] - [0.5, 0.0, 0.0]).fits
    assert len(Segmenter().segment(world.reshape(frame.shape), up=(0, 0, 1)).objects) == 2


def test_a_bare_plane_looks_alike_from_everywhere() -> None:
    T = look_down(20.0)
    frame, _ = render([], T, 0.0)
    points = frame.reshape(-1, 3)
    valid = np.isfinite(points).all(axis=1)
    for viewpoint in (np.zeros(3), np.array([0.1, 0.2, -0.1])):
        assert LinesOfSight(points, valid, frame.shape[:2], viewpoint).fits
