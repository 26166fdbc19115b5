"""What the arm would hit: against brute force on points, on the table, on itself."""

from itertools import pairwise

import numpy as np
import pytest

from pecgrasp_env.motion.clearance import Clearance
from pecgrasp_env.motion.collision import CELL_M, Surroundings, hits_itself
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.policy.viewpoints import look_postures
from pecgrasp_env.robot import description, forward_kinematics
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.collision_spheres import body
from pecgrasp_env.robot.kinematics import HOME, inverse_kinematics

TABLE = np.array([0.0, 0.0, 1.0, 0.0])
NOTHING = np.zeros((0, 3))


def block(x, y, height, half=0.03):
    """Points (N, 3) of the top of a block."""
    side = np.arange(-half, half + 1e-9, 0.003)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return np.column_stack([grid + np.array([x, y]), np.full(len(grid), height)])


def test_spheres_against_columns_of_points():
    """A sphere hits the map where it reaches a point, or the column under one; the cells blur by less than two."""
    rng = np.random.default_rng(0)
    points = np.concatenate([block(0.5, 0.0, 0.10), block(0.6, 0.1, 0.04)])
    surroundings = Surroundings(points, TABLE)
    radius = np.array([0.015, 0.05])
    centres = rng.uniform((0.35, -0.15, 0.0), (0.75, 0.25, 0.25), size=(1000, 1, 3)).repeat(2, axis=1)
    for k, r in enumerate(radius):
        hit = surroundings.hit_by(centres[:, k : k + 1], radius[k : k + 1], 0.0)
        delta = centres[:, k, None] - points
        delta[..., 2] = np.maximum(delta[..., 2], 0.0)  # under a seen surface all is solid
        distance = np.linalg.norm(delta, axis=2).min(axis=1)
        assert hit[distance < r - 2 * CELL_M].all()
        assert not hit[distance > r + 2 * CELL_M].any()
        assert hit.any()
        assert not hit.all()


def test_a_margin_is_a_larger_sphere():
    surroundings = Surroundings(block(0.5, 0.0, 0.10), TABLE)
    centre = np.array([[[0.5, 0.0, 0.125]]])
    assert not surroundings.hit_by(centre, np.array([0.02]), 0.0)[0]
    assert surroundings.hit_by(centre, np.array([0.02]), 0.01)[0]


def test_an_empty_table_is_hit_only_as_a_table():
    surroundings = Surroundings(NOTHING, TABLE)
    centre = np.array([[[0.5, 0.0, 0.03]]])
    assert not surroundings.hit_by(centre, np.array([0.05]), 0.05)[0]
    assert surroundings.near_table(centre, np.array([0.025]), 0.01)[0]
    assert not surroundings.near_table(centre, np.array([0.015]), 0.01)[0]


def test_the_table_may_lean():
    normal = np.array([0.1, 0.0, 1.0]) / np.linalg.norm([0.1, 0.0, 1.0])
    surroundings = Surroundings(NOTHING, np.append(normal, 0.0))
    assert surroundings.near_table(np.array([[[-0.5, 0.0, 0.06]]]), np.array([0.02]), 0.01)[0]
    assert not surroundings.near_table(np.array([[[0.5, 0.0, 0.06]]]), np.array([0.02]), 0.01)[0]


@pytest.mark.parametrize("opening", [0.0, 0.06, linkage.STROKE])
def test_the_pads_are_covered_where_the_linkage_has_them(opening):
    """Tips of both pads, in tool0's frame, at the closed form's place, lie within spheres of the fingertips."""
    spheres = body(opening)
    place = linkage.STROKE if opening > 0.135 else opening
    depth = 0.006 + float(linkage.pad_depth(place)) + linkage.PAD_LENGTH / 2
    for side in (-1, 1):
        tip = np.array([side * (place + linkage.PAD_THICKNESS) / 2, 0.0, depth - 0.003])
        gap = np.linalg.norm(spheres.centre[spheres.fingertip] - tip, axis=1) - spheres.radius[spheres.fingertip]
        assert gap.min() < 0.002


def test_every_link_with_a_collision_shape_has_spheres():
    spheres = body(0.1)
    assert set(spheres.frame) == set(range(7))
    assert len(spheres.frame) >= sum(len(link.collision) for link in description.links())
    moved = spheres.at(np.stack([HOME, HOME]))
    assert moved.shape == (2, len(spheres.frame), 3)
    tool = forward_kinematics(HOME)
    hand = spheres.frame == 6
    np.testing.assert_allclose(moved[0, hand], spheres.centre[hand] @ tool[:3, :3].T + tool[:3, 3], atol=1e-12)


def test_usual_postures_do_not_touch_the_arm_and_folded_ones_do():
    robot = body(linkage.STROKE)
    usual = np.stack([HOME, *look_postures()])
    assert not hits_itself(robot, robot.at(usual)).any()
    folded = np.array([[0.0, -1.5, 2.95, -1.5, -1.5, 0.0], [0.0, -0.5, 2.6, -4.3, 1.57, 0.0]])
    assert hits_itself(robot, robot.at(folded)).all()


def posture(x, y, z):
    T = forward_kinematics(HOME)
    T[:3, 3] = (x, y, z)
    solutions = inverse_kinematics(T)
    return solutions[np.abs(np.angle(np.exp(1j * (solutions - HOME)))).sum(axis=1).argmin()]


def test_it_goes_round_a_wall_and_says_where_it_cannot():
    wall = np.concatenate([block(0.5, y, 0.30, 0.02) for y in np.arange(-0.06, 0.061, 0.03)])
    low = 0.33  # height of the flange; the fingertips are a quarter of a metre lower
    start, goal = posture(0.4, -0.22, low), posture(0.4, 0.25, low)
    clearance = Clearance(NOTHING, wall, TABLE)
    empty = Clearance(NOTHING, NOTHING, TABLE)
    assert len(empty.free_path(start, goal)) == 2
    path = clearance.free_path(start, goal)
    assert len(path) > 2
    np.testing.assert_array_equal(path[[0, -1]], [start, goal])
    np.testing.assert_array_equal(path, clearance.free_path(start, goal))
    robot = body(linkage.STROKE)
    fine = np.concatenate([a + (b - a) * np.linspace(0, 1, 40)[:, None] for a, b in pairwise(path)])
    moving = robot.frame >= 2
    assert not Surroundings(wall, TABLE).hit_by(robot.at(fine)[:, moving], robot.radius[moving], 0.0).any()
    with pytest.raises(MotionError, match="in the way"):
        clearance.free_path(start, posture(0.5, 0.0, low))


def test_room_at_an_object():
    down = np.stack([posture(0.5, 0.0, z) for z in (0.40, 0.33, 0.26)])
    target = block(0.5, 0.0, 0.05, 0.02)
    assert Clearance(target, NOTHING, TABLE).trouble_at_object(down, 0.08, False) is None
    tower = block(0.5, 0.11, 0.25, 0.02)
    around = Clearance(
        target, np.concatenate([tower, tower * [1, -1, 1], block(0.6, 0, 0.25), block(0.4, 0, 0.25)]), TABLE
    )
    assert around.trouble_at_object(down, 0.08, False) == "another object is in the arm's way"
    deep = np.stack([posture(0.5, 0.0, z) for z in (0.40, 0.10)])
    assert (
        Clearance(target, NOTHING, TABLE).trouble_at_object(deep, 0.08, False) == "a link would come too near the table"
    )
