"""Paths between postures, in a world that is known exactly."""

from itertools import pairwise

import numpy as np
import pytest

from pecgrasp_env.motion.rrt_connect import STEP_RAD, NoPathError, between, free_path

START, GOAL = np.zeros(6), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def wall(q):
    """Free but for a wall across the way, with room above it in the second joint."""
    return ~((np.abs(q[:, 0] - 0.5) < 0.1) & (q[:, 1] < 0.6))


def test_the_straight_way_where_it_is_free():
    path = free_path(START, GOAL, lambda q: np.ones(len(q), bool))
    np.testing.assert_array_equal(path, [START, GOAL])


def test_over_a_posture_that_is_named():
    over = np.array([0.5, 0.8, 0, 0, 0, 0])
    path = free_path(START, GOAL, wall, over=(over * [1, 0, 0, 0, 0, 0], over))
    np.testing.assert_array_equal(path, [START, over, GOAL])


def test_round_a_wall_and_the_same_each_time():
    path = free_path(START, GOAL, wall)
    np.testing.assert_array_equal(path[[0, -1]], [START, GOAL])
    assert all(wall(between(a, b)).all() for a, b in pairwise(path))
    np.testing.assert_array_equal(path, free_path(START, GOAL, wall))


def test_a_goal_that_is_not_free_and_a_prison():
    with pytest.raises(NoPathError, match="where the arm should go"):
        free_path(START, GOAL, lambda q: q[:, 0] < 0.9)
    with pytest.raises(NoPathError, match="no way round"):
        free_path(START, GOAL, lambda q: (q[:, 0] < 0.1) | (q[:, 0] > 0.9))


def test_a_start_among_things_is_left():
    path = free_path(START, GOAL, lambda q: np.abs(q[:, 0]) > 1e-6)
    np.testing.assert_array_equal(path, [START, GOAL])


def test_checked_postures_lie_close():
    steps = between(START, GOAL)
    assert np.abs(np.diff(steps, axis=0, prepend=START[None])).max() <= STEP_RAD + 1e-12
    np.testing.assert_array_equal(steps[-1], GOAL)
    np.testing.assert_array_equal(between(START, START), [START])
