"""Joint paths: straight, within joint speeds, and above the table."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasping import ROBOTIQ_2F_140, Grasp
from grasping.grasp import plan_from
from pecgrasp_env.motion.clearance import Clearance
from pecgrasp_env.motion.grasp_approach import clear_of_table, plan_approach
from pecgrasp_env.motion.joint_path import MotionError, straight_line, unwound
from pecgrasp_env.motion.trajectory import JOINT_ACCELERATION, JOINT_SPEED, time_law
from pecgrasp_env.policy.viewpoints import look_at, look_postures, posture_above
from pecgrasp_env.robot import T_TOOL0_CAMERA, forward_kinematics, tool0_from_grasp
from pecgrasp_env.robot.kinematics import COUPLER, HOME

TABLE = np.array([0.0, 0.0, 1.0, 0.0])
NOTHING = np.zeros((0, 3))


def top_down(x, y, z, yaw=0.0):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("z", yaw).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    T[:3, 3] = (x, y, z)
    return T


def test_the_tool_moves_on_a_straight_line():
    T_start = forward_kinematics(HOME)
    T_end = T_start.copy()
    T_end[:3, 3] += (0.05, -0.10, -0.20)
    path = straight_line(HOME, T_start, T_end)
    tools = np.array([forward_kinematics(q) for q in path])
    direction = (T_end - T_start)[:3, 3] / np.linalg.norm((T_end - T_start)[:3, 3])
    along = (tools[:, :3, 3] - T_start[:3, 3]) @ direction
    off = tools[:, :3, 3] - T_start[:3, 3] - along[:, None] * direction
    assert np.abs(off).max() < 1e-9
    assert np.abs(tools[:, :3, :3] - T_start[:3, :3]).max() < 1e-9
    assert (np.diff(along) > 0).all()
    assert tools[-1] == pytest.approx(T_end)


def test_a_line_out_of_reach_is_refused():
    T_start = forward_kinematics(HOME)
    T_end = T_start.copy()
    T_end[0, 3] += 1.0
    with pytest.raises(MotionError, match="reach"):
        straight_line(HOME, T_start, T_end)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 6), st.floats(0.1, 1.0))
def test_the_time_law_keeps_speed_and_acceleration_and_ends_at_the_end(seed, n, speed):
    rng = np.random.default_rng(seed)
    waypoints = rng.uniform(-1, 1, size=(n, 6))
    dt = 0.05
    targets = np.concatenate([waypoints[:1], time_law(waypoints, dt, speed)])
    steps = np.abs(np.diff(targets, axis=0)).max(axis=1) / dt
    assert steps.max() <= speed * JOINT_SPEED + 1e-9
    assert steps[0] <= JOINT_ACCELERATION * dt / 2 + 1e-9
    assert targets[-1] == pytest.approx(waypoints[-1])


def test_to_stay_is_one_target():
    assert time_law(np.tile(HOME, (3, 1)), 0.05) == pytest.approx(HOME[None])


def test_angles_go_on_over_a_full_turn():
    path = np.array([[3.0] * 6, [-3.1] * 6, [-2.9] * 6])
    assert unwound(path) == pytest.approx(np.array([[3.0] * 6, [2 * np.pi - 3.1] * 6, [2 * np.pi - 2.9] * 6]))


@pytest.mark.parametrize("width", [0.0, 0.03, 0.12])
@pytest.mark.parametrize("height", [0.0, 0.02, 0.08])
def test_fingertips_stay_off_the_table(width, height):
    T = clear_of_table(top_down(0.5, 0.1, height), width, TABLE)
    tip = T[2, 3] - ROBOTIQ_2F_140.pad_length / 2
    assert tip > 0.0009
    assert T[:2, 3] == pytest.approx(np.array([0.5, 0.1]))
    if height > 0.05:
        assert pytest.approx(top_down(0.5, 0.1, height)) == T
    assert tool0_from_grasp(T, width)[2, 3] > 0.2


@pytest.mark.parametrize("tilt", [0.0, 0.3, -0.6])
@pytest.mark.parametrize("width", [0.002, 0.06, 0.125])
def test_while_it_closes_the_hand_goes_back_by_what_the_pads_advance(width, tilt):
    """So the tips stay where they are to hold, from the opening to come in with to the closed hand."""
    T_grasp = top_down(0.5, 0.1, 0.05, yaw=0.4)
    T_grasp[:3, :3] @= Rotation.from_euler("x", tilt).as_matrix()
    plan = plan_from([Grasp(T_grasp, width, 1.0, "region", None, {"opening": min(width + 0.05, 0.14)})], [], "")
    approach = plan_approach(plan, np.array([[0.5, 0.1, 0.04]]), NOTHING, TABLE, HOME)
    assert approach.to_close[0] == pytest.approx(approach.to_grasp[-1])
    for opening in np.linspace(0.0, approach.opening, 23):
        T = forward_kinematics(approach.posture_at(opening))
        pads = T[:3, 3] + (COUPLER + ROBOTIQ_2F_140.pad_depth(opening)) * T[:3, 2]
        assert pads == pytest.approx(approach.T_base_grasp[:3, 3], abs=3e-4)
        assert T[:3, 2] == pytest.approx(approach.T_base_grasp[:3, 2], abs=1e-3)
    assert forward_kinematics(approach.to_lift[-1])[2, 3] == pytest.approx(approach.T_base_tool0[2, 3] + 0.25)


def test_the_views_look_at_the_table():
    for q in look_postures():
        T = forward_kinematics(q) @ T_TOOL0_CAMERA
        hit = T[:3, 3] - T[:3, 2] * T[2, 3] / T[2, 2]
        assert np.linalg.norm(hit[:2] - (0.5, 0.0)) < 0.03
        assert len(Clearance(NOTHING, NOTHING, TABLE).free_path(HOME, q)) == 2


@pytest.mark.parametrize("place", [(0.35, 0.2), (0.6, -0.2), (0.9, 0.0)])
def test_one_object_is_looked_at_from_above(place):
    for turn in (1, 2):
        T = forward_kinematics(posture_above(np.array([*place, 0.03]), turn)) @ T_TOOL0_CAMERA
        assert T[2, 2] == pytest.approx(-1.0, abs=1e-9)
        assert np.linalg.norm(T[:2, 3] - place) < (0.01 if place[0] < 0.8 else 0.3)


def test_look_at_is_a_camera_with_x_up_in_its_picture():
    T = look_at((0.5, 0.0, 0.5), (0.5, 0.0, 0.0))
    assert T[:3, :3] == pytest.approx(np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1]], float), abs=1e-12)
