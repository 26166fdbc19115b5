"""What tells a model from a thing of nearly its shape: noise differs from point to point, a wrong shape does not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seen_stones import cut_out, model_of, pose

from grasping.pose.acceptance import AMONG, NAMED, differ, refusal, shared_residual
from grasping.pose.candidates import Judged, Sought, judge, tolerance_at
from grasping.pose.prepared_model import PreparedModel
from grasping.pose.scene_surface import seen_surface
from grasping.pose.view import View

TOLERANCE = tolerance_at(0.6)
CAN = pose(6)


def judged(points: np.ndarray, normals: np.ndarray) -> tuple[Judged, Sought]:
    """The can where it is, against points (N, 3) of its surface."""
    sought = Sought(points, normals, View.of(points, np.zeros(3)), None, TOLERANCE)
    return judge(PreparedModel(model_of("can")), sought, CAN[None]), sought


@pytest.fixture(scope="module")
def side() -> tuple[np.ndarray, np.ndarray]:
    """What is seen of the can."""
    return seen_surface(cut_out("can", CAN), np.zeros(3), 0.005)


def test_all_of_what_neighbours_are_off_together_counts(side) -> None:
    points, normals = side
    shared = [shared_residual(*judged(points + off * normals, normals)) for off in (0.0, 0.001)]
    assert shared[0] < 0.0002
    assert shared[1] == pytest.approx(0.001, abs=0.0002)


def test_noise_is_hardly_shared(side) -> None:
    points, normals = side
    noise = np.random.default_rng(0).normal(0, 0.3 * TOLERANCE, len(points))[:, None]
    one, sought = judged(points + noise * normals, normals)
    assert one.residual[0] > 0.25 * TOLERANCE
    assert shared_residual(one, sought) < 0.15 * TOLERANCE
    assert refusal(one, sought, AMONG) == ""


def test_a_surface_that_bends_otherwise_is_refused(side) -> None:
    points, normals = side
    along = (points - CAN[:3, 3]) @ CAN[:3, 2]
    wave = 0.6 * TOLERANCE * np.sin(along / 0.012)[:, None]  # a bulge each 8 cm
    one, sought = judged(points + wave * normals, normals)
    assert one.inliers[0] > 0.9
    assert shared_residual(one, sought) > AMONG.shared * TOLERANCE
    assert "bends otherwise" in refusal(one, sought, AMONG)
    assert refusal(one, sought, NAMED) == ""  # where the thing is known to be a can


def test_on_too_few_points_nothing_is_shared(side) -> None:
    one, sought = judged(side[0][:5], side[1][:5])
    assert shared_residual(one, sought) == np.inf


def test_what_stands_before_the_measured_is_refused(side) -> None:
    points, normals = side
    cut = (points - CAN[:3, 3]) @ CAN[:3, 2] < 0.03
    behind = points[~cut] * 1.2
    both = np.concatenate([points[cut], behind])
    sought = Sought(points[cut], normals[cut], View.of(both, np.zeros(3)), None, TOLERANCE)
    one = judge(PreparedModel(model_of("can")), sought, CAN[None])
    assert one.clear[0] > NAMED.clear
    assert "in front of what was seen" in refusal(one, sought, NAMED)


def test_a_turn_onto_itself_is_no_other_pose_and_a_tilt_is() -> None:
    can = model_of("can")
    for degrees, axis, other in ((37, "z", False), (180, "x", False), (37, "x", True), (90, "y", True)):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
        assert differ(can, CAN, CAN @ T) == other, (degrees, axis)
