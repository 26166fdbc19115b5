"""Neighbours in one picture: apart where table is seen between them, and only there."""

import numpy as np
import pytest

from grasping import Segmenter

PIXEL = 0.0025  # m of the table a pixel, seen from straight above
UP = (0.0, 0.0, 1.0)


def frame(*boxes, noise=0.0, shape=(100, 140)):
    """(H, W, 3) m of a table from above with boxes (row, column, rows, columns, height in m) on it."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    height = np.random.default_rng(0).normal(scale=noise, size=shape) if noise else np.zeros(shape)
    for row, column, tall, wide, top in boxes:
        height[row : row + tall, column : column + wide] = top
    return np.stack([columns * PIXEL, rows * PIXEL, height], axis=-1).astype(np.float32)


def seen(cloud):
    return Segmenter().segment(cloud + np.float32([0, 0, 0.5]), up=UP).objects


@pytest.mark.parametrize("noise", [0.0, 0.0015])
@pytest.mark.parametrize("gap", [2, 3, 5])
def test_two_boxes_a_few_pixels_apart_are_two(gap, noise):
    """5, 7.5 and 12.5 mm of table: less than the gap that footprints need."""
    objects = seen(frame((20, 20, 30, 20, 0.04), (20, 40 + gap, 30, 25, 0.03), noise=noise))
    assert [len(points) for points in objects] == pytest.approx([750, 600], abs=30)


def test_a_bare_table_has_nothing_to_tell_apart():
    assert seen(frame()) == []


def test_two_boxes_that_touch_are_one():
    assert len(seen(frame((20, 20, 30, 20, 0.04), (20, 40, 30, 25, 0.03)))) == 1


def test_a_crack_of_lost_depth_does_not_part_an_object():
    cloud = frame((20, 20, 30, 60, 0.04))
    cloud[20:50, 48:50, 2] = np.nan
    assert len(seen(cloud)) == 1


def test_a_low_object_with_a_dent_stays_one():
    """Noise brings a line of a flat object down to the table's band, but not to the table."""
    cloud = frame((20, 20, 12, 60, 0.009))
    cloud[20:32, 50, 2] = 0.004
    assert len(seen(cloud)) == 1


def test_a_flying_pixel_is_no_bridge():
    cloud = frame((20, 20, 30, 25, 0.04), (20, 48, 30, 25, 0.04))
    cloud[35, 45:48, 2] = 0.04
    assert len(seen(cloud)) == 2


def test_a_handle_is_a_bridge():
    cloud = frame((20, 20, 30, 25, 0.04), (33, 45, 5, 5, 0.04), (20, 50, 30, 25, 0.04))
    assert len(seen(cloud)) == 1


def test_crumbs_stay_with_the_nearest():
    cloud = frame((20, 20, 30, 20, 0.04), (20, 43, 30, 25, 0.03), (52, 24, 4, 4, 0.02))
    assert sorted(len(points) for points in seen(cloud)) == pytest.approx([600 + 16, 750], abs=10)


def test_what_is_seen_through_a_ring_of_another_thing_and_beside_it_is_taken_apart():
    """Inside of the ring no pixel of the back one borders on nothing: it had no border to look between."""
    cloud = frame((30, 30, 20, 20, 0.05), (30, 53, 20, 20, 0.05))
    ring = np.zeros(cloud.shape[:2], dtype=bool)
    ring[28:52, 28:52] = True
    ring[30:50, 30:50] = False
    cloud[ring] += np.float32([0, 0.08, 0.10])  # nearer to the camera, over another place of the table
    objects = seen(cloud)
    assert sorted(len(points) for points in objects) == [176, 400, 400]
