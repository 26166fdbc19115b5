"""An object that others lie on is tipped to their side: its end there stays low, and the hand finds room or says so."""

import numpy as np
import pytest

from grasping.grasp import Grasp
from pecgrasp_env.motion.grasp_approach import Approach
from pecgrasp_env.motion.joint_path import MotionError, solutions_near, straight_line
from pecgrasp_env.policy.tip_off import plan_tipped_lift, tipped
from pecgrasp_env.robot import tool0_from_grasp
from pecgrasp_env.robot.kinematics import UP, forward_kinematics

PADS = np.array([0.5, 0.0, 0.03])
TABLE = np.array([0.0, 0.0, 1.0, 0.0])
BAR = PADS + np.stack([np.linspace(-0.02, 0.08, 60), np.zeros(60), np.zeros(60)], axis=1)  # held near one end
UPON = PADS + np.array([[0.05, -0.01, 0.03], [0.06, 0.01, 0.03]])


@pytest.fixture
def approach():
    T_grasp = np.eye(4)
    T_grasp[:3, :3] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])  # closes along y, from above
    T_grasp[:3, 3] = PADS
    T_tool0 = tool0_from_grasp(T_grasp, 0.03)
    q = solutions_near(T_tool0)[0]
    T_up = T_tool0.copy()
    T_up[2, 3] += 0.25
    grasp = Grasp(T_grasp, 0.03, 1.0, "edge", 0)
    lift = straight_line(q, T_tool0, T_up)[1:]
    return Approach(grasp, 0.06, T_grasp, T_tool0, q[None], q[None], q[None], lift)


@pytest.mark.parametrize("angle", [0.2, 0.7])
def test_the_end_on_their_side_stays_and_the_other_rises(angle):
    T = np.eye(4)
    T[:3, 3] = PADS + 0.2 * UP
    side = np.array([0.6, 0.8])
    moved = tipped(T, PADS, side, angle, 0.08) @ np.linalg.inv(T)
    low, pads = (moved @ np.append(p, 1.0) for p in (PADS + 0.08 * np.append(side, 0.0), PADS))
    assert low[2] == pytest.approx(PADS[2] + 0.005)
    assert pads[2] == pytest.approx(PADS[2] + 0.005 + 0.08 * np.sin(angle))
    assert pads[:2] == pytest.approx(PADS[:2])


def test_it_is_tipped_to_their_side_and_then_lifted_as_planned(approach):
    lift = plan_tipped_lift(approach.to_grasp[-1], approach, BAR, UPON, UPON, None)
    closed, tip, end = (forward_kinematics(q) for q in (lift.tip[0], lift.tip[-1], lift.up[-1]))
    turn = tip[:3, :3] @ closed[:3, :3].T
    assert turn @ [1, 0, 0] == pytest.approx([np.cos(np.deg2rad(40)), 0, -np.sin(np.deg2rad(40))], abs=1e-6)
    np.testing.assert_allclose(end, forward_kinematics(approach.to_lift[-1]), atol=1e-6)
    assert np.abs(np.diff(np.concatenate([lift.tip, lift.up]), axis=0)).max() < 0.4


def test_another_side_is_taken_where_the_hand_has_no_room_and_none_where_all_are_taken(approach):
    heading = np.arange(-np.pi, np.pi, 0.02)
    ring = np.stack([0.13 * np.cos(heading), 0.13 * np.sin(heading)], axis=1)
    height = np.arange(0.0, 0.25, 0.004)
    ahead = np.abs(heading) < 0.5

    def wall(which):
        foot = PADS[:2] + ring[which]
        return np.concatenate([np.column_stack([foot, np.full(len(foot), z)]) for z in height])

    lift = plan_tipped_lift(approach.to_grasp[-1], approach, BAR, UPON, wall(ahead), TABLE)
    turned = forward_kinematics(lift.tip[-1])[:3, :3] @ forward_kinematics(lift.tip[0])[:3, :3].T @ UP
    assert np.degrees(np.abs(np.arctan2(turned[1], turned[0]))) > 30
    with pytest.raises(MotionError):
        plan_tipped_lift(approach.to_grasp[-1], approach, BAR, UPON, wall(np.full(len(heading), True)), TABLE)
