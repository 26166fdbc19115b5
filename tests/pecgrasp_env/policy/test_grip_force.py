"""How hard the policy holds: gently what lies flat, and harder where it slid out before."""

import numpy as np
import pytest

from pecgrasp_env.policy.grip_force import grip_force, mean_height


def top_of(length, width, height, z=0.0):
    """Points (M, 3) on the upper face of a box whose lower face is at z."""
    x, y = np.meshgrid(np.arange(0, length, 0.002), np.arange(0, width, 0.002))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z + height)], axis=1)


def test_the_height_is_that_above_the_table_wherever_the_points_are_dense():
    low = np.add(top_of(0.1, 0.1, 0.01), [0.1, 0.0, 0.0])
    assert mean_height(np.vstack([top_of(0.1, 0.1, 0.05), low, low, low]), None) == pytest.approx(0.03, rel=0.02)
    raised = np.array([0.0, 0.0, 1.0, -0.3])
    assert mean_height(top_of(0.2, 0.1, 0.05, z=0.3), raised) == pytest.approx(0.05)


def test_what_is_flat_is_held_gently_and_harder_where_it_slipped():
    plate, pliers = top_of(0.2, 0.024, 0.006), top_of(0.15, 0.03, 0.018)
    assert grip_force(plate, None, slipped=False) == 30.0
    assert grip_force(pliers, None, slipped=False) == 60.0
    assert grip_force(top_of(0.1, 0.1, 0.013), None, slipped=False) == pytest.approx(45.0)
    assert grip_force(plate, None, slipped=True) == 70.0
    assert grip_force(pliers, None, slipped=True) == 100.0
