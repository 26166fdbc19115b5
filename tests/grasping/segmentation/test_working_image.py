"""The image that touching things are told apart in."""

import numpy as np
import pytest

from grasping import Segmenter
from grasping.segmentation.frame import Frame
from grasping.segmentation.working_image import MOST_PIXELS, reduce_blocks, reduce_blocks_reference
from tests.grasping.rendered_scenes import look_down, render, up_in

PLANE = np.array([0.1, -0.2, -0.97, 0.65])
PLANE /= np.linalg.norm(PLANE[:3])


def plane_frame(height: int, width: int, focal: float) -> np.ndarray:
    """(H, W, 3) of a plane that fills the view."""
    x = (np.arange(width) - width / 2) / focal
    y = ((np.arange(height) - height / 2) / focal)[:, None]
    z = -PLANE[3] / (PLANE[0] * x + PLANE[1] * y + PLANE[2])
    return np.stack([x * z, y * z, z], axis=-1)


@pytest.mark.parametrize(("height", "width"), [(240, 320), (240, 424), (480, 640), (720, 1280)])
def test_the_image_is_of_one_size_and_a_plane_is_affine_in_it(height: int, width: int) -> None:
    image = Frame(plane_frame(height, width, 0.8 * width), (0.0, 2.0)).working_image(None)
    assert image is not None
    h, w = image.shape
    assert h * w <= MOST_PIXELS
    np.testing.assert_allclose(image.inverse_depth, image.plane_inverse_depth(PLANE), rtol=2e-5)
    positions = image.positions().reshape(-1, 3).astype(np.float64)
    np.testing.assert_allclose(positions @ PLANE[:3], -PLANE[3], atol=2e-5)
    assert image.cells.max() < h * w


def test_the_same_in_another_frame_with_the_viewpoint_told() -> None:
    turn = look_down(35.0, 0.7)
    moved = plane_frame(120, 160, 140.0) @ turn[:3, :3].T + turn[:3, 3]
    image = Frame(moved, (0.0, 2.0), turn[:3, 3]).working_image(None)
    assert image is not None
    normal = turn[:3, :3] @ PLANE[:3]
    there = np.append(normal, PLANE[3] - normal @ turn[:3, 3])
    np.testing.assert_allclose(image.inverse_depth, image.plane_inverse_depth(there), rtol=2e-5)


def test_a_loose_cloud_is_drawn_as_its_camera_saw_it() -> None:
    cloud = plane_frame(200, 300, 250.0).reshape(-1, 3)
    chosen = np.random.default_rng(0).permutation(len(cloud))[:40_000]
    image = Frame(cloud[chosen], (0.0, 2.0)).working_image(None)
    assert image is not None
    drawn = image.inverse_depth > 0
    assert drawn.mean() > 0.6
    np.testing.assert_allclose(image.inverse_depth[drawn], image.plane_inverse_depth(PLANE)[drawn], rtol=5e-3)
    assert (image.cells >= 0).all()


def test_a_cloud_of_the_world_without_a_viewpoint_has_none() -> None:
    T = look_down(30.0, 0.6)
    frame, _ = render([(0, 0, 0.1, 0.1, 0.1)], T)
    world = frame.reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]
    assert Frame(world, (0.0, 2.0)).working_image(np.array([0.0, 0.0, 1.0, 0.0])) is None


def test_a_cloud_that_was_not_seen_from_its_origin_is_told_apart_without_a_viewpoint_and_says_so() -> None:
    # As if seen straight down, and seen aslant in truth: of the sides of boxes that one saw, the lids hide much.
    T = look_down(50.0, 0.8)
    boxes = [(0.15 * i - 0.15, 0.0, 0.08, 0.08, 0.12) for i in range(3)]
    frame, _ = render(boxes, T, 0.0005)
    seen = frame[np.isfinite(frame[..., 2])]
    world = seen @ T[:3, :3].T + T[:3, 3]
    near = np.abs(world[:, :2]).max(axis=1) < 0.35
    seen, world = seen[near], world[near]
    down = (np.array([1.0, -1.0, -1.0]) * world + [0.0, 0.0, 0.7]).astype(np.float32)  # z down, above the table
    scene = Segmenter().segment(down, up=[0.0, 0.0, -1.0])
    assert len(scene.objects) == 3
    assert scene.viewpoint is None
    assert any("viewpoint" in entry.why for entry in scene.rejected)
    told = Segmenter().segment(seen, up=up_in(T))
    assert told.viewpoint is not None
    assert not any("viewpoint" in entry.why for entry in told.rejected)


def test_a_block_is_the_mean_about_its_median_and_a_hole_where_half_is_missing() -> None:
    q = np.array([[1.0, 1.002, 0, 0, 0, 3], [1.004, 2.0, 0, 1.5, 3.004, 3]], dtype=np.float32)
    for reduce in (reduce_blocks, reduce_blocks_reference):
        np.testing.assert_allclose(reduce(q, 2), [[1.002, 0.0, 3.0013333]], rtol=1e-6)
