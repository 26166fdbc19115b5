"""The field's measures of a pose, against answers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_shapes import box
from scipy.spatial.transform import Rotation

from grasping.pose.depth_image import depth_image
from grasping.pose.metrics import add, add_s, auc, mssd, vsd
from grasping.pose.symmetry import Symmetry

K = np.array([[500.0, 0, 49.5], [0, 500.0, 39.5], [0, 0, 1]])
SHAPE = (80, 100)


def pose(x=0.0, y=0.0, z=0.0, turn=0.0):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("z", turn, degrees=True).as_matrix()
    T[:3, 3] = x, y, z
    return T


SQUARE = np.array([[0.1, 0, 0], [0, 0.1, 0], [-0.1, 0, 0], [0, -0.1, 0.0]])


def test_moving_by_3_and_4_is_5_off():
    assert add(SQUARE, pose(0.003, 0.004), pose()) == pytest.approx(0.005)
    assert mssd(SQUARE, pose(0.003, 0.004), pose(), Symmetry(np.eye(4)[None])) == pytest.approx(0.005)


def test_a_quarter_turn_of_a_square_is_far_for_add_and_nothing_for_add_s():
    assert add(SQUARE, pose(turn=90), pose()) == pytest.approx(0.1 * np.sqrt(2))
    assert add_s(SQUARE, pose(turn=90), pose()) == pytest.approx(0, abs=1e-12)


def test_add_s_takes_for_each_true_point_the_nearest_estimated_one():
    points = np.array([[0.0, 0, 0], [0.1, 0, 0]])
    assert add_s(points, pose(x=0.1), pose()) == pytest.approx((0.1 + 0.0) / 2)
    assert add_s(points, pose(x=-0.3), pose()) == pytest.approx((0.2 + 0.3) / 2)


def test_mssd_is_of_the_farthest_point_at_the_best_turn():
    half = Symmetry(np.stack([pose(), pose(turn=180)]))
    assert mssd(SQUARE, pose(turn=180), pose(), half) == pytest.approx(0, abs=1e-12)
    assert mssd(SQUARE, pose(turn=90), pose(), half) == pytest.approx(0.1 * np.sqrt(2))
    tilted = np.array([[0.1, 0, 0], [0.02, 0, 0]])
    assert mssd(tilted, pose(turn=60), pose(), Symmetry(np.eye(4)[None])) == pytest.approx(0.1)  # 2 r sin 30°


def test_mssd_about_an_axis_is_within_a_step_of_nothing_for_any_angle():
    round_about = Symmetry(np.eye(4)[None], (np.zeros(3), np.array([0.0, 0, 1])))
    assert mssd(SQUARE, pose(turn=33.3), pose(), round_about) < 0.01 * 0.2 * np.sqrt(2)
    assert mssd(SQUARE, pose(x=0.02, turn=33.3), pose(), round_about) == pytest.approx(0.02, abs=0.002)


def test_mssd_of_a_ball_is_the_distance_of_its_centres():
    ball = Symmetry(np.eye(4)[None], ball=np.array([0.0, 0, 0.05]))
    tilted = np.eye(4)
    tilted[:3, :3] = Rotation.from_euler("x", 180, degrees=True).as_matrix()
    assert mssd(SQUARE, tilted, pose(), ball) == pytest.approx(0.1)


def test_area_under_the_curve():
    assert auc([0.0, 0.0]) == 1
    assert auc([0.1, np.inf]) == 0
    assert auc([0.0, 0.05, 0.2, np.inf]) == pytest.approx(1.5 / 4)  # 1 + ½ + 0 + 0
    thresholds = np.linspace(0, 0.1, 100_001)
    errors = np.array([0.003, 0.02, 0.0777, 0.3])
    assert auc(errors) == pytest.approx((errors[:, None] <= thresholds).mean(), abs=1e-4)
    with pytest.raises(ValueError, match="none"):
        auc([])


def test_a_box_is_drawn_where_a_camera_sees_it():
    image = depth_image(*box(0.04, 0.02, 0.06), pose(z=0.53), K, SHAPE)
    rows, columns = np.nonzero(image)
    np.testing.assert_allclose(image[image > 0], 0.5)  # its front face hides the rest
    assert (columns.min(), columns.max()) == (30, 69)  # 49.5 ± 20 px
    assert (rows.min(), rows.max()) == (30, 49)
    assert len(rows) == 40 * 20


def test_a_slope_has_each_pixels_own_depth():
    corners = 0.4 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    plate = corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    T = pose(z=0.5)
    T[:3, :3] = Rotation.from_euler("y", 30, degrees=True).as_matrix()
    image = depth_image(*plate, T, K, SHAPE)
    x = (np.arange(100) - 49.5) / 500
    np.testing.assert_allclose(image, np.tile(0.5 / (1 + x * np.tan(np.radians(30))), (80, 1)))


def test_vsd_counts_pixels():
    flat = np.zeros(SHAPE)
    true, estimated = flat.copy(), flat.copy()
    true[10:20, 10:30] = 0.5  # 200 pixels
    estimated[10:20, 20:40] = 0.5  # half of them, and as many others
    scene = np.full(SHAPE, 0.6)
    scene[10:20, 10:30] = 0.5
    np.testing.assert_allclose(vsd(scene, true, true, K, 0.1), 0)
    np.testing.assert_allclose(vsd(scene, estimated, true, K, 0.1), 200 / 300)
    nearer = np.where(true > 0, 0.488, 0.0)
    errors = vsd(scene, nearer, true, K, 0.1, taus=(0.05, 0.1, 0.15))  # 12 mm of 100 mm, a little more off the axis
    np.testing.assert_allclose(errors, [1, 1, 0])


def test_vsd_leaves_out_what_is_hidden():
    true, estimated = np.zeros(SHAPE), np.zeros(SHAPE)
    true[10:20, 10:30] = 0.5
    estimated[10:20, 10:40] = 0.5
    scene = np.full(SHAPE, 0.5)
    scene[:, 20:] = 0.3  # something stands before the right of both
    np.testing.assert_allclose(vsd(scene, estimated, true, K, 0.1), 0)
    scene[:, 30:] = 0.0  # nothing was measured: the estimate's pixels there count
    np.testing.assert_allclose(vsd(scene, estimated, true, K, 0.1), 100 / 200)
    assert vsd(scene, np.zeros(SHAPE), np.zeros(SHAPE), K, 0.1).tolist() == [1] * 10
