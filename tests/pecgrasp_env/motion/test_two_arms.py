"""Two arms on one table: what either reaches, that they carry in step, and that they do not meet."""

import numpy as np
import pytest

from grasping import Grasp
from pecgrasp_env.motion.clearance import ROBOTS_APART_M
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.motion.two_arms import arms_gap, can_reach, carry, plan_approaches
from pecgrasp_env.robot.kinematics import forward_kinematics
from pecgrasp_env.robot.two_arm_bases import MIDDLE, T_WORLD_BASE, WAITING

TABLE = np.array([0.0, 0.0, 1.0, 0.0])
GOAL = np.array([0.05, -0.08, 0.2])


def grasp_at(x, y, z=0.02, width=0.05):
    """Straight down, closing along x."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, y, z
    return Grasp(pose, width, 1.0, "region")


def beam():
    x, y = (axis.reshape(-1) for axis in np.meshgrid(np.arange(-0.025, 0.026, 0.005), np.arange(-0.3, 0.301, 0.005)))
    return np.column_stack([x + MIDDLE[0], y, np.full(len(x), 0.03)])


def tools(q):
    """T_world_tool0 (2, 4, 4) of both arms at joint angles (2, 6)."""
    return np.array([T_WORLD_BASE[arm] @ forward_kinematics(q[arm]) for arm in (0, 1)])


def test_the_arms_wait_apart_and_beside_the_middle():
    assert arms_gap(WAITING[None])[0] > 0.2
    np.testing.assert_allclose(tools(WAITING)[:, 1, 3], 0.37, atol=0.01)
    np.testing.assert_allclose(tools(WAITING)[:, 0, 3].sum(), 2 * MIDDLE[0], atol=1e-5)  # mirrored


@pytest.mark.parametrize(("x", "reached"), [(0.45, [True, True]), (0.25, [True, True]), (-0.25, [True, False])])
def test_reach_is_from_each_arms_own_base(x, reached):
    for arm in (0, 1):
        mirrored = x if arm == 0 else 2 * MIDDLE[0] - x
        assert can_reach(grasp_at(mirrored, 0.2), TABLE, GOAL, arm) == reached[0]
        assert can_reach(grasp_at(mirrored, 0.2), TABLE, GOAL, 1 - arm) == reached[1]


def test_both_come_to_their_grasps_and_carry_in_step():
    grasps = {0: grasp_at(MIDDLE[0], -0.2), 1: grasp_at(MIDDLE[0], 0.2)}
    approaches = plan_approaches(grasps, beam(), TABLE, WAITING, GOAL)
    closed = {arm: approach.posture_at(0.05) for arm, approach in approaches.items()}
    for arm, approach in approaches.items():
        np.testing.assert_allclose(approach.to_pregrasp[0], WAITING[arm])
        other = WAITING[1] if arm == 0 else closed[0]
        way = np.concatenate([approach.to_pregrasp[1:], approach.to_grasp])
        both = np.stack([way, np.repeat(other[None], len(way), axis=0)], axis=1)
        assert arms_gap(both if arm == 0 else both[:, ::-1]).min() > 0
    targets = carry(closed, (0, 1), GOAL, dt=0.05)
    start, ways = tools([closed[0], closed[1]]), np.array([tools(q) for q in targets])
    moved = ways[:, :, :3, 3] - start[:, :3, 3]
    np.testing.assert_allclose(moved[:, 0], moved[:, 1], atol=1e-6)  # in step: neither pulls at the other
    np.testing.assert_allclose(moved[-1, 0], GOAL, atol=1e-6)
    np.testing.assert_allclose(ways[:, :, :3, :3] - start[:, :3, :3], 0.0, atol=1e-6)
    assert (np.diff(moved[:, 0, 2]) > -1e-9).all()
    assert arms_gap(targets).min() >= ROBOTS_APART_M


def test_one_arm_carries_while_the_other_stands():
    approaches = plan_approaches({1: grasp_at(*MIDDLE)}, beam(), TABLE, WAITING, GOAL)
    assert list(approaches) == [1]
    targets = carry({0: WAITING[0], 1: approaches[1].posture_at(0.05)}, (1,), GOAL, dt=0.05)
    np.testing.assert_array_equal(targets[:, 0], np.repeat(WAITING[:1], len(targets), axis=0))


def test_two_hands_at_one_place_are_refused():
    with pytest.raises(MotionError):
        plan_approaches({0: grasp_at(MIDDLE[0], 0.0), 1: grasp_at(MIDDLE[0], 0.05)}, beam(), TABLE, WAITING, GOAL)


def test_a_goal_out_of_reach_is_refused():
    with pytest.raises(MotionError, match="out of reach"):
        carry({0: WAITING[0], 1: WAITING[1]}, (0, 1), np.array([0.0, 0.0, 0.9]), dt=0.05)
