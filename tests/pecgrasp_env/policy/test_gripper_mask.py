"""The gripper's own points: the shortcut by depth changes nothing."""

import numpy as np
import pytest

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.policy.observation import observation_of_frame
from pecgrasp_env.policy.perception import gripper_mask
from pecgrasp_env.policy.viewpoints import look_postures, posture_above, posture_beside
from pecgrasp_env.robot.kinematics import HOME, T_TOOL0_CAMERA, T_TOOL0_GRIPPER, forward_kinematics
from pecgrasp_env.sensor.intrinsics import D435

ELSEWHERE = T_TOOL0_CAMERA @ np.array([[0, -1, 0, 0.05], [1, 0, 0, 0], [0, 0, 1, -0.02], [0, 0, 0, 1.0]])


@pytest.mark.parametrize("mount", [T_TOOL0_CAMERA, ELSEWHERE], ids=["bracket", "elsewhere"])
@pytest.mark.parametrize("opening", [0.0, 0.05, ROBOTIQ_2F_140.stroke])
def test_exactly_the_points_in_the_grippers_box_are_masked(opening, mount):
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.4, 0.4, (200, 300, 3)).astype(np.float32)
    points[rng.random((200, 300)) < 0.1] = np.nan
    T = np.linalg.inv(T_TOOL0_GRIPPER) @ mount
    p = points.astype(float) @ T[:3, :3].T + T[:3, 3]
    tip = ROBOTIQ_2F_140.pad_depth(opening) + ROBOTIQ_2F_140.pad_length / 2 + 0.015
    inside = (np.abs(p[..., 0]) < 0.055) & (np.abs(p[..., 1]) < max(opening / 2 + 0.03, 0.06) + 0.015)
    inside &= (p[..., 2] > 0) & (p[..., 2] < tip)
    assert inside.any()
    assert np.array_equal(gripper_mask(points, opening, mount), inside)


def test_the_mounting_follows_from_where_camera_and_arm_are():
    """So a calibrated camera, or one beside the robot, loses the gripper where it is, not where the bracket's would."""
    intrinsics, depth = D435["424x240"], np.zeros((240, 424))
    seen = observation_of_frame(depth, intrinsics, forward_kinematics(HOME) @ ELSEWHERE, HOME, 0.05)
    np.testing.assert_allclose(seen.T_tool0_camera, ELSEWHERE, atol=1e-12)
    unknown = observation_of_frame(depth, intrinsics, ELSEWHERE, None, 0.05)
    np.testing.assert_array_equal(unknown.T_tool0_camera, T_TOOL0_CAMERA)


def test_postures_bring_a_camera_that_is_mounted_otherwise_to_the_same_places():
    for usual, other in zip(look_postures(), look_postures(ELSEWHERE), strict=True):
        there, here = forward_kinematics(usual) @ T_TOOL0_CAMERA, forward_kinematics(other) @ ELSEWHERE
        np.testing.assert_allclose(here, there, atol=1e-6)
    place = np.array([0.5, 0.1, 0.02])
    for find in (lambda T: posture_above(place, 1, T), lambda T: posture_beside(place, np.array([1.0, 0.0]), T)):
        there, here = (forward_kinematics(find(T)) @ T for T in (T_TOOL0_CAMERA, ELSEWHERE))
        np.testing.assert_allclose(here, there, atol=1e-6)
