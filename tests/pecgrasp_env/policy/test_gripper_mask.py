"""The gripper's own points: the shortcut by depth changes nothing."""

import numpy as np
import pytest

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.policy.perception import gripper_mask
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA, T_TOOL0_GRIPPER


@pytest.mark.parametrize("opening", [0.0, 0.05, ROBOTIQ_2F_140.stroke])
def test_exactly_the_points_in_the_grippers_box_are_masked(opening):
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.4, 0.4, (200, 300, 3)).astype(np.float32)
    points[rng.random((200, 300)) < 0.1] = np.nan
    T = np.linalg.inv(T_TOOL0_GRIPPER) @ T_TOOL0_CAMERA
    p = points.astype(float) @ T[:3, :3].T + T[:3, 3]
    tip = ROBOTIQ_2F_140.pad_depth(opening) + ROBOTIQ_2F_140.pad_length / 2 + 0.015
    inside = (np.abs(p[..., 0]) < 0.055) & (np.abs(p[..., 1]) < max(opening / 2 + 0.03, 0.06) + 0.015)
    inside &= (p[..., 2] > 0) & (p[..., 2] < tip)
    assert inside.any()
    assert np.array_equal(gripper_mask(points, opening), inside)
