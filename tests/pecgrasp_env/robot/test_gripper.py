"""The 2F-140 in the real simulator: it opens to the millimetre, squeezes as told, holds, and stays in one piece."""

import numpy as np
import pytest
import sapien
from scipy.spatial.transform import Rotation

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot import nearest_solution, tool0_from_grasp

OPENINGS = np.linspace(0, linkage.STROKE, 15)


def opening_errors(bench, q, openings):
    """Settle at each opening; measured minus commanded, and the pads' place off the closed form, m."""
    errors, offsets = [], []
    for opening in openings:
        bench.hold(q, opening, 60, 0.8)
        errors.append(bench.agent.gripper_opening.item() - opening)
        flange = bench.matrix(bench.agent.robot.links_map["wrist_3_link"])
        pads = bench.agent.pads_pose.sp.to_transformation_matrix()
        expected = tool0_from_grasp(pads, opening)[:3, 3]
        offsets.append(np.linalg.norm(flange[:3, 3] - expected))
    return np.abs(errors), np.array(offsets)


@pytest.mark.slow
def test_opening_and_depth_follow_the_command_over_the_stroke_also_after_100_cycles(bench):
    b = bench()
    q = b.grasp_posture(b.DOWN, 0.06)
    b.place(q, linkage.STROKE)
    errors, offsets = opening_errors(b, q, OPENINGS)
    assert errors.max() < 1e-3
    assert offsets.max() < 1e-3
    for _ in range(100):
        b.hold(q, 0.0, 60, 0.7)
        b.hold(q, linkage.STROKE, 60, 0.7)
    errors, offsets = opening_errors(b, q, OPENINGS[::-1])
    assert errors.max() < 1e-3
    assert offsets.max() < 1e-3


@pytest.mark.parametrize("off_centre", [0.0, 0.02])
def test_pads_stay_parallel_squeezing_a_60_mm_block_with_100_newtons(bench, off_centre):
    b = bench(blocks=[{"size": (0.05, 0.06, 0.05), "mass": 0.3}])
    q = b.grip(b.blocks[0], width=0.06, force=100, offset=off_centre)
    tilts = []
    b.hold(q, 0.0, 100, 1.0, lambda: tilts.append(b.pad_tilt()))
    assert b.agent.is_grasping(b.blocks[0]).all()
    assert np.rad2deg(max(tilts)) < 1.0


@pytest.mark.parametrize("width", [0.02, 0.06, 0.13])
@pytest.mark.parametrize("force", [20, 60, 125])
def test_squeeze_force_is_the_commanded_one(bench, force, width):
    b = bench(blocks=[{"size": (0.05, width, 0.05), "mass": 0.3}])
    q = b.grip(b.blocks[0], width, force)
    measured = []
    fingers = (b.agent.left_finger, b.agent.right_finger)
    b.hold(q, 0.0, force, 1.0, lambda: measured.append([b.pad_force(finger, b.blocks[0]) for finger in fingers]))
    np.testing.assert_allclose(np.mean(measured, axis=0), force, rtol=0.2)


@pytest.mark.parametrize("force", [20, 60, 125])
def test_a_1_kg_block_of_friction_06_is_held_while_the_wrist_is_shaken_at_half_g(bench, force):
    # A contact's friction is the mean of both materials': 0.4 here and 0.8 of the pads make 0.6.
    b = bench(blocks=[{"size": (0.06, 0.06, 0.08), "mass": 1.0, "friction": 0.4}], control_freq=100)
    block = b.blocks[0]
    q = b.grip(block, 0.06, force)
    place = b.in_pads(block)
    flange, slip = [], []
    for step in range(500):
        T = b.DOWN.copy()
        shaken = step * 3 // 500  # x, y, z in turn, 4 Hz
        T[shaken, 3] += 0.0126 * np.sin(2 * np.pi * 4 * step / 100)
        q = nearest_solution(tool0_from_grasp(T, 0.06), q)
        b.act(q, 0.0, force)
        flange.append(b.matrix(b.agent.robot.links_map["wrist_3_link"])[:3, 3])
        slip.append(np.linalg.norm(b.in_pads(block)[:3, 3] - place[:3, 3]))
        assert b.agent.is_grasping(block).all()
    acceleration = np.abs(np.diff(flange, n=2, axis=0)) * 100**2
    for axis in range(3):
        assert acceleration[axis * 500 // 3 : (axis + 1) * 500 // 3 - 2, axis].max() > 0.5 * 9.81
    assert max(slip) < 2e-3


@pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.slow)])
def test_random_openings_closings_and_collisions_leave_it_in_one_piece(bench, count):
    b = bench(blocks=[{"size": (0.06, 0.05, 0.2), "pose": sapien.Pose([0.5, 0, 0.15])}])
    rng = np.random.default_rng(0)
    home = q = b.agent.keyframes["home"].qpos[:6]
    b.place(q, linkage.STROKE)
    worst, touched = [], 0
    while len(worst) < count:
        # Somewhere about the block's upper end, turned and tilted: beside it, round it, or into it.
        T = b.DOWN.copy()
        turn = rng.uniform([-np.pi / 2, -0.4, -0.4], [np.pi / 2, 0.4, 0.4])
        T[:3, :3] = Rotation.from_euler("zyx", turn).as_matrix() @ T[:3, :3]
        T[:3, 3] = np.array([0.5, 0, 0.25]) + rng.uniform([-0.1, -0.1, -0.06], [0.1, 0.1, 0.1])
        goal = b.grasp_posture(T, 0.07)
        if goal is None or np.abs(goal - home).max() > 2.0:  # no flips, which drive the fingers through the arm
            continue
        opening, force = rng.uniform(0, linkage.STROKE), rng.uniform(linkage.MIN_FORCE, linkage.MAX_FORCE)
        snapshots = []
        steps = max(10, int(np.ceil(np.abs(goal - q).max() / 1.5 * b.control_freq)))  # at most 1.5 rad/s
        for target in np.linspace(q, goal, steps + 1)[1:]:
            b.act(target, opening, force, lambda: snapshots.append(b.snapshot()))  # noqa: B023
        q = goal
        worst.append(b.separation(snapshots).max())
        touched += b.any_contact(b.blocks[0])
        assert b.joint_gap() < 2e-3
    assert touched > count / 5  # a test of collisions
    assert max(worst) < 2e-3
    b.place(b.grasp_posture(b.DOWN, 0.06), 0.06)
    errors, _ = opening_errors(b, b.q[:6], [0.03, 0.12])
    assert errors.max() < 1e-3


def test_the_planner_and_the_simulator_speak_of_one_gripper():
    assert ROBOTIQ_2F_140.stroke == linkage.STROKE
    assert (ROBOTIQ_2F_140.min_force, ROBOTIQ_2F_140.max_force) == (linkage.MIN_FORCE, linkage.MAX_FORCE)
    for opening in OPENINGS:
        assert ROBOTIQ_2F_140.pad_depth(opening) == pytest.approx(linkage.pad_depth(opening), abs=1e-5)


def test_fingers_travel_at_no_more_than_250_mm_per_second(bench):
    b = bench()
    q = b.grasp_posture(b.DOWN, 0.06)
    b.place(q, linkage.STROKE)
    openings = [linkage.STROKE]
    b.hold(q, 0.0, 125, 0.7, lambda: openings.append(b.agent.gripper_opening.item()))
    assert openings[-1] < 1e-3
    over_100_ms = np.abs(np.array(openings[10:]) - np.array(openings[:-10])) / 0.1
    assert over_100_ms.max() < 0.260
    assert over_100_ms.max() > 0.230  # the data sheet's speed is reached


def test_a_gripper_stopped_by_an_object_opens_again_at_once(bench):
    b = bench(blocks=[{"size": (0.05, 0.1, 0.05), "mass": 0.3}])
    q = b.grip(b.blocks[0], 0.1, 60)
    b.hold(q, 0.0, 60, 1.0)
    b.hold(q, linkage.STROKE, 60, 0.25)
    assert b.agent.gripper_opening.item() > 0.13  # 40 mm at 250 mm/s take 0.16 s


def test_grasping_needs_the_object_between_both_pads(bench):
    size = (0.04, 0.06, 0.04)
    b = bench(blocks=[{"size": size, "mass": 0.2}, {"size": size, "mass": 0.2}])
    held, other = b.blocks
    b.place(b.grasp_posture(b.DOWN, 0.06), 0.1)
    assert not b.agent.is_grasping(held)
    assert not b.agent.is_grasping()
    b.grip(held, 0.06, 40)
    assert b.agent.is_grasping(held)
    assert b.agent.is_grasping()
    assert not b.agent.is_grasping(other)


def test_one_pad_alone_does_not_grasp(bench):
    b = bench(blocks=[{"size": (0.04, 0.03, 0.04), "pose": sapien.Pose([0.5, 0.04, 0.3])}])
    q = b.grasp_posture(b.DOWN, 0.06)
    b.place(q, linkage.STROKE)
    b.hold(q, 0.0, 20, 0.8)  # a fixed block stops one pad, and through it the other
    assert b.any_contact(b.blocks[0])
    assert not b.agent.is_grasping(b.blocks[0])
    assert not b.agent.is_grasping()
