"""Symmetries are found from a surface alone, in any place and turn of it."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_shapes import ball, bottle, box, lathe, moved, mug, prism
from scipy.spatial.transform import Rotation

from grasping.pose.object_model import object_model
from grasping.pose.symmetry import Symmetry

PLACED = np.eye(4)
PLACED[:3, :3] = Rotation.from_euler("xyz", (0.5, -0.8, 1.9)).as_matrix()
PLACED[:3, 3] = (0.03, -0.2, 0.11)


def model(mesh):
    return object_model(*moved(mesh, PLACED), "it")


@pytest.mark.parametrize(
    ("mesh", "turns"),
    [
        pytest.param(box(0.05, 0.08, 0.13), 4, id="box"),
        pytest.param(box(0.07, 0.07, 0.13), 8, id="square box"),
        pytest.param(box(0.08, 0.08, 0.08), 24, id="cube"),
        pytest.param(prism(6, 0.05, 0.06), 12, id="hexagonal prism"),
        pytest.param(prism(3, 0.05, 0.06), 6, id="triangular prism"),
        pytest.param(mug(), 1, id="mug"),
    ],
)
def test_discrete_turns(mesh, turns):
    found = model(mesh)
    assert found.symmetry.axis is None
    assert found.symmetry.ball is None
    assert len(found.symmetry.turns) == turns
    np.testing.assert_array_equal(found.symmetry.turns[0], np.eye(4))
    for turn in found.symmetry.turns:  # each is proper and leaves the mesh's corners on its surface, of flat faces here
        np.testing.assert_allclose(turn[:3, :3] @ turn[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(turn[:3, :3]) == pytest.approx(1)
        centre = found.vertices.mean(axis=0)
        assert turns == 1 or np.linalg.norm(turn[:3, :3] @ centre + turn[:3, 3] - centre) < 0.01 * found.diameter


@pytest.mark.parametrize(
    ("mesh", "turns"),
    [
        pytest.param(prism(64, 0.03, 0.1), 2, id="cylinder"),
        pytest.param(bottle(), 1, id="bottle"),
        pytest.param(lathe([(0, 0), (0.03, 0), (0.07, 0.05), (0.067, 0.05), (0.028, 0.004), (0, 0.004)]), 1, id="bowl"),
    ],
)
def test_any_angle_about_an_axis(mesh, turns):
    symmetry = model(mesh).symmetry
    assert symmetry.axis is not None
    point, direction = symmetry.axis
    assert abs(direction @ PLACED[:3, 2]) > np.cos(np.radians(1))
    off = point - PLACED[:3, 3]
    assert np.linalg.norm(off - (off @ PLACED[:3, 2]) * PLACED[:3, 2]) < 0.001
    assert len(symmetry.turns) == turns


def test_a_ball_may_be_turned_any_way():
    symmetry = model(ball(0.04)).symmetry
    assert symmetry.ball is not None
    np.testing.assert_allclose(symmetry.ball, PLACED[:3, 3], atol=0.0005)
    assert symmetry.axis is None


def test_steps_about_an_axis_are_as_fine_as_asked_and_begin_with_the_identity():
    symmetry = Symmetry(np.eye(4)[None], (np.array([0.1, 0, 0]), np.array([0.0, 0, 1])))
    every = symmetry.transforms(np.radians(10))
    assert every.shape == (36, 4, 4)
    np.testing.assert_array_equal(every[0], np.eye(4))
    np.testing.assert_allclose(every @ (0.1, 0, 0.3, 1), np.tile((0.1, 0, 0.3, 1), (36, 1)), atol=1e-12)
    assert not symmetry.is_trivial
    assert Symmetry(np.eye(4)[None]).is_trivial


@pytest.mark.parametrize("mesh", [box(0.05, 0.08, 0.13), prism(64, 0.03, 0.1), bottle(), ball(0.04), mug()])
def test_the_nearest_of_equal_poses_is_the_goal_where_the_goal_is_one_of_them(mesh):
    found = model(mesh)
    goal = np.eye(4)
    goal[:3, :3] = Rotation.from_euler("xyz", (1.5, 0.3, -0.7)).as_matrix()
    goal[:3, 3] = (0.1, 0.2, 0.9)
    every = found.symmetry.transforms(0.3)
    alike = goal @ every[len(every) * 2 // 3]
    nearest = found.symmetry.nearest(alike, goal)
    off = np.linalg.norm((nearest - goal) @ np.c_[found.points, np.ones(len(found.points))].T, axis=0).max()
    assert off < 0.02 * found.diameter  # of the turns' own inexactness
