"""Forward and inverse kinematics of the UR5, without the simulator."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.arm_lengths import JOINT_LIMITS
from pecgrasp_env.robot.kinematics import (
    COUPLER,
    T_TOOL0_CAMERA,
    T_TOOL0_GRIPPER,
    forward_kinematics,
    inverse_kinematics,
    nearest_solution,
    tool0_from_grasp,
    with_turns,
)

joint_vectors = st.lists(st.floats(-np.pi, np.pi), min_size=6, max_size=6).map(np.array)


def turn_distance(a, b):
    """Greatest joint difference up to whole turns."""
    return np.abs(np.angle(np.exp(1j * (a - b)))).max(-1)


def test_forward_kinematics_gives_the_published_positions():
    np.testing.assert_allclose(forward_kinematics(np.zeros(6))[:3, 3], [0.81725, 0.19145, -0.005491], atol=1e-9)
    upright = forward_kinematics(np.array([0, -np.pi / 2, 0, -np.pi / 2, 0, 0]))
    np.testing.assert_allclose(upright[:3, 3], [0, 0.19145, 1.001059], atol=1e-9)


def test_inverse_kinematics_recovers_1000_random_postures():
    rng = np.random.default_rng(0)
    for q in rng.uniform(-np.pi, np.pi, (1000, 6)):
        T = forward_kinematics(q)
        postures = inverse_kinematics(T)
        assert 1 <= len(postures) <= 8
        assert turn_distance(postures, q).min() < 1e-6
        for posture in postures:
            np.testing.assert_allclose(forward_kinematics(posture), T, atol=1e-9)


@settings(max_examples=200, deadline=None)
@given(joint_vectors)
def test_every_posture_reaches_the_pose_also_near_singularities(q):
    T = forward_kinematics(q)
    postures = inverse_kinematics(T)
    assert len(postures) >= 1
    assert np.abs(postures).max() <= np.pi
    for posture in postures:
        np.testing.assert_allclose(forward_kinematics(posture), T, atol=1e-6)


@pytest.mark.parametrize("q5", [0.0, np.pi])
def test_at_a_wrist_singularity_the_free_joint_is_ours_to_choose(q5):
    q = np.array([0.3, -1.2, 1.0, 0.4, q5, 0.7])
    T = forward_kinematics(q)
    for free in (0.7, -2.0):
        postures = inverse_kinematics(T, q6_if_free=free)
        assert len(postures) > 0
        for posture in postures:
            np.testing.assert_allclose(forward_kinematics(posture), T, atol=1e-9)
    np.testing.assert_allclose(nearest_solution(T, q), q, atol=1e-6)


def test_a_stretched_arm_is_still_within_reach():
    q = np.array([0.5, -0.8, 0.0, -0.3, 1.2, 0.1])
    postures = inverse_kinematics(forward_kinematics(q))
    assert turn_distance(postures, q).min() < 1e-4  # the elbow's angle is a root of a difference here


@pytest.mark.parametrize("position", [(1.2, 0, 0.3), (0.0, 0.0, 0.5), (0.02, 0.0, 0.4)])
def test_out_of_reach_has_no_posture(position):
    T = np.eye(4)
    T[:3, 3] = position  # too far; and inside the cylinder that the wrist's offset keeps from the base's axis
    assert inverse_kinematics(T).shape == (0, 6)
    assert nearest_solution(T, np.zeros(6)) is None


@settings(max_examples=100, deadline=None)
@given(joint_vectors, st.lists(st.floats(-6, 6), min_size=6, max_size=6).map(np.array))
def test_nearest_solution_is_the_nearest_of_all_turns_within_limits(q, reference):
    reference[2] = np.clip(reference[2], -np.pi, np.pi)
    T = forward_kinematics(q)
    everything = with_turns(inverse_kinematics(T, q6_if_free=reference[5]))
    assert (everything >= JOINT_LIMITS[:, 0]).all()
    assert (everything <= JOINT_LIMITS[:, 1]).all()
    distance = np.linalg.norm(everything - reference, axis=1)
    nearest = nearest_solution(T, reference)
    assert np.linalg.norm(nearest - reference) == pytest.approx(distance.min(), abs=1e-9)


def test_a_short_move_keeps_the_posture():
    rng = np.random.default_rng(1)
    for q in rng.uniform(-np.pi, np.pi, (100, 6)):
        moved = q + rng.uniform(-0.02, 0.02, 6)
        moved = np.clip(moved, JOINT_LIMITS[:, 0], JOINT_LIMITS[:, 1])
        np.testing.assert_allclose(nearest_solution(forward_kinematics(moved), q), moved, atol=1e-5)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="T_base_tool0"):
        inverse_kinematics(np.eye(3))
    with pytest.raises(ValueError, match="T_base_tool0"):
        inverse_kinematics(np.full((4, 4), np.nan))
    with pytest.raises(ValueError, match="q must have shape"):
        forward_kinematics(np.zeros(7))
    with pytest.raises(ValueError, match="width"):
        tool0_from_grasp(np.eye(4), 0.15)


def test_tool0_stands_behind_the_grasp_by_coupler_and_pad_depth():
    grasp = np.eye(4)
    grasp[:3, :3] = Rotation.from_euler("xyz", [0.4, 2.0, -1.0]).as_matrix()
    grasp[:3, 3] = [0.5, 0.1, 0.2]
    for width, depth in ((0.0, 0.20066), (0.06, 0.19594), (0.14, 0.17171)):  # the published linkage's pad centres
        offset = np.linalg.inv(tool0_from_grasp(grasp, width)) @ grasp
        np.testing.assert_allclose(offset[:3, :3], np.eye(3), atol=1e-12)
        np.testing.assert_allclose(offset[:3, 3], [0, 0, COUPLER + depth], atol=1e-5)


def test_gripper_and_camera_stand_on_the_flange_as_documented():
    closing, approach = T_TOOL0_GRIPPER[:3, 1], T_TOOL0_GRIPPER[:3, 2]
    np.testing.assert_array_equal(closing, [1, 0, 0])
    np.testing.assert_array_equal(approach, [0, 0, 1])
    for T in (T_TOOL0_GRIPPER, T_TOOL0_CAMERA):
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3))
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1)


class TestLinkage:
    def test_published_openings_angles_and_depths(self):
        openings, joints = [0.140, 0.1285, 0.100, 0.060, 0.0], [-0.078, 0.0, 0.175, 0.394, 0.699]
        np.testing.assert_allclose(linkage.crank_joint(openings), joints, atol=6e-4)
        np.testing.assert_allclose(linkage.pad_depth(openings), [0.1717, 0.1770, 0.1871, 0.1959, 0.2007], atol=6e-5)

    @given(st.floats(0, linkage.STROKE))
    def test_opening_and_crank_joint_are_inverse(self, opening):
        assert linkage.opening(linkage.crank_joint(opening)) == pytest.approx(opening, abs=1e-12)

    def test_torque_is_the_work_of_the_force_over_the_opening(self):
        q, step = 0.3, 1e-6
        closed_by = -(linkage.opening(q + step) - linkage.opening(q - step)) / (2 * step) / 2  # m/rad, each finger
        assert linkage.crank_torque(50.0, q) == pytest.approx(50.0 * closed_by, rel=1e-8)
