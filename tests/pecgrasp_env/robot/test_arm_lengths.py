"""Other arms than the UR5, and one arm as its factory measured it."""

import numpy as np
import pytest

from pecgrasp_env.robot.arm_lengths import DH, JOINT_LIMITS, UR5, ArmLengths
from pecgrasp_env.robot.batch_kinematics import inverse_kinematics_batch
from pecgrasp_env.robot.collision_spheres import body
from pecgrasp_env.robot.kinematics import HOME, forward_kinematics, home, inverse_kinematics, nearest_solution
from tests.pecgrasp_env.robot.known_arms import MEASURED_UR10, UR3, UR10, UR10E, measured

POSTURES = np.random.default_rng(0).uniform(-2.5, 2.5, (40, 6))


def test_a_ur10_has_its_flange_where_the_maker_says():
    """Joint angles and places that Universal Robots' own driver is tested with; its base frame is turned by half."""
    q = [-1.6007002035724085, -1.7271001974688929, -2.202999893818999]
    q += [-0.8079999128924769, 1.5951000452041626, -0.03099996248354131]
    place = forward_kinematics(np.array(q), UR10)[:3, 3]
    assert place == pytest.approx([0.179925914147547, 0.606869755162764, 0.230789102067257], abs=1e-9)


@pytest.mark.parametrize("arm", [UR3, UR5, UR10, UR10E], ids=["UR3", "UR5", "UR10", "UR10e"])
def test_each_posture_is_among_those_of_its_pose(arm):
    for q in POSTURES:
        T = forward_kinematics(q, arm)
        found = inverse_kinematics(T, arm=arm)
        assert np.abs(np.angle(np.exp(1j * (found - q)))).max(axis=1).min() < 1e-6
        assert all(np.abs(forward_kinematics(each, arm) - T).max() < 1e-9 for each in found)


def test_a_measured_arm_is_moved_by_its_own_lengths():
    """A real UR10's table, with offsets of more than a metre that cancel each other."""
    away = [
        np.linalg.norm((forward_kinematics(q, MEASURED_UR10) - forward_kinematics(q, UR10))[:3, 3]) for q in POSTURES
    ]
    assert min(away) > 0.5e-3
    assert max(away) < 10e-3
    poses = np.array([forward_kinematics(q, MEASURED_UR10) for q in POSTURES])
    batch = inverse_kinematics_batch(poses, MEASURED_UR10)
    reached = 0
    for T, q, branches in zip(poses, POSTURES, batch, strict=True):
        found = inverse_kinematics(T, arm=MEASURED_UR10)
        branches = branches[np.isfinite(branches).all(axis=1)]
        for each in [*found, *branches]:
            assert np.abs(forward_kinematics(each, MEASURED_UR10) - T).max() < 1e-7
        reached += len(found) > 0 and np.abs(np.angle(np.exp(1j * (found - q)))).max(axis=1).min() < 1e-5
        assert len(found) <= len(branches)
    assert reached >= 38  # where the arm is stretched or the wrist singular, its type's postures are no beginning
    assert nearest_solution(poses[0], POSTURES[0], MEASURED_UR10) == pytest.approx(POSTURES[0], abs=1e-5)


def test_lengths_that_depart_by_nothing_are_those_of_the_type():
    same = measured(UR5, 0.0)
    for q in POSTURES[:5]:
        assert forward_kinematics(q, same) == pytest.approx(forward_kinematics(q), abs=1e-12)
    assert body(0.1, same).at(POSTURES) == pytest.approx(body(0.1).at(POSTURES), abs=1e-12)


def test_the_home_posture_looks_down_at_the_table_within_reach():
    assert home(UR5) is HOME
    assert home(measured(UR5)) is HOME
    assert forward_kinematics(home(UR10E), UR10E) == pytest.approx(forward_kinematics(HOME), abs=1e-9)
    T = forward_kinematics(home(UR3), UR3)
    assert UR3.share == 0.56
    assert T[:2, 3] == pytest.approx(0.56 * forward_kinematics(HOME)[:2, 3])
    assert T[2, 2] == pytest.approx(-1)
    with pytest.raises(ValueError, match="cannot look down at the table"):
        home(ArmLengths(DH * [0.1, 1, 1], JOINT_LIMITS, 0.1))


def test_the_links_of_a_larger_arm_are_longer_and_thicker_and_its_hand_the_same():
    one, other = body(0.1), body(0.1, UR10E)
    assert (other.radius >= one.radius).all()
    hand = one.frame == 6
    np.testing.assert_array_equal(one.radius[hand], other.radius[hand])
    upper = one.frame == 2
    assert np.ptp(other.centre[upper, 0]) == pytest.approx(np.ptp(one.centre[upper, 0]) * 0.6127 / 0.425)


def test_other_joints_than_a_urs_are_refused():
    with pytest.raises(ValueError, match="joints 2 to 4 parallel"):
        ArmLengths(DH + np.array([0, 0, 0.1]), JOINT_LIMITS, 0.149)
