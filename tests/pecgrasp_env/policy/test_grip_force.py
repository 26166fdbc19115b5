"""How hard the policy holds: by the room that an object takes up, and harder where it slid out before."""

import numpy as np
import pytest

from pecgrasp_env.policy.grip_force import grip_force, volume_to_table


def top_of(length, width, height, z=0.0):
    """Points (M, 3) on the upper face of a box whose lower face is at z."""
    x, y = np.meshgrid(np.arange(0, length, 0.002), np.arange(0, width, 0.002))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z + height)], axis=1)


def test_the_volume_is_that_between_surface_and_table():
    assert volume_to_table(top_of(0.2, 0.1, 0.05), None) == pytest.approx(1e-3, rel=0.02)
    raised = np.array([0.0, 0.0, 1.0, -0.3])
    assert volume_to_table(top_of(0.2, 0.1, 0.05, z=0.3), raised) == pytest.approx(1e-3, rel=0.02)


def test_what_is_small_is_held_gently_and_harder_where_it_slipped():
    plate, brick = top_of(0.2, 0.024, 0.006), top_of(0.2, 0.1, 0.05)
    assert grip_force(plate, None, slipped=False) == 30.0
    assert grip_force(brick, None, slipped=False) == 60.0
    between = grip_force(top_of(0.1, 0.1, 0.01), None, slipped=False)
    assert between == pytest.approx(45.0, abs=2.0)
    assert grip_force(plate, None, slipped=True) == 70.0
    assert grip_force(brick, None, slipped=True) == 100.0
