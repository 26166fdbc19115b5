"""Kinematics of many postures at once: the same as one by one."""

import numpy as np
import pytest

from pecgrasp_env.robot.arm_lengths import JOINT_LIMITS
from pecgrasp_env.robot.batch_kinematics import BRANCHES, inverse_kinematics_batch, joint_frames, nearest_turns
from pecgrasp_env.robot.kinematics import forward_kinematics, inverse_kinematics


def postures(n, seed=0):
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (n, 6))


def test_the_last_frame_is_tool0():
    q = postures(50)
    frames = joint_frames(q)
    assert frames.shape == (50, 6, 4, 4)
    np.testing.assert_allclose(frames[:, -1], [forward_kinematics(each) for each in q], atol=1e-12)


def test_branches_are_the_solutions_found_one_by_one():
    T = np.array([forward_kinematics(q) for q in postures(200)])
    batch = inverse_kinematics_batch(T)
    assert batch.shape == (200, BRANCHES, 6)
    for pose, branches in zip(T, batch, strict=True):
        reached = branches[~np.isnan(branches).any(axis=1)]
        alone = inverse_kinematics(pose)
        assert len(reached) == len(alone)
        for q in alone:
            assert np.abs(np.angle(np.exp(1j * (reached - q)))).max(axis=1).min() < 1e-9


def test_out_of_reach_is_nan():
    T = np.tile(np.eye(4), (2, 1, 1))
    T[:, :3, 3] = [(1.2, 0.0, 0.3), (0.02, 0.0, 0.4)]
    assert np.isnan(inverse_kinematics_batch(T)).all()


def test_along_a_line_each_branch_is_one_path():
    T = np.tile(forward_kinematics(np.array([-0.3, -1.7, 1.3, -1.1, -1.5, -0.3])), (30, 1, 1))
    T[:, 2, 3] -= np.linspace(0.0, 0.2, 30)
    branches = inverse_kinematics_batch(T)
    steps = np.abs(np.angle(np.exp(1j * np.diff(branches, axis=0))))
    assert steps[~np.isnan(steps)].max() < 0.1


def test_nearest_turns_stay_within_the_limits():
    q = postures(300, seed=1)
    q_ref = np.array([5.0, -5.0, 2.0, 0.0, -3.0, 3.0])
    turned = nearest_turns(q, q_ref)
    assert (turned >= JOINT_LIMITS[:, 0]).all()
    assert (turned <= JOINT_LIMITS[:, 1]).all()
    np.testing.assert_allclose(np.exp(1j * turned), np.exp(1j * q), atol=1e-9)
    free = np.abs(turned - q_ref) > np.pi + 1e-9  # only where the nearer turn is beyond a limit
    nearer = turned - 2 * np.pi * np.round((turned - q_ref) / (2 * np.pi))
    assert ((nearer < JOINT_LIMITS[:, 0]) | (nearer > JOINT_LIMITS[:, 1]))[free].all()


@pytest.mark.parametrize("shape", [(6,), (2, 3, 6)])
def test_frames_of_any_leading_shape(shape):
    assert joint_frames(np.zeros(shape)).shape == (*shape, 4, 4)
