import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from pec.pose.rotations import ROTATIONS, from_6d, from_axis_angle, from_quaternion

QUARTER_ABOUT_Z = torch.tensor([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def test_a_quarter_turn_about_z_in_each_form():
    turns = [
        from_axis_angle(torch.tensor([0, 0, math.pi / 2])),
        from_quaternion(torch.tensor([2.0, 0, 0, 2.0])),  # of any length
        from_6d(torch.tensor([0.0, 3, 0, -1, 5, 0])),  # the second column made orthogonal to the first
    ]
    for turn in turns:
        torch.testing.assert_close(turn, QUARTER_ABOUT_Z, atol=1e-6, rtol=0)


@pytest.mark.parametrize("name", ROTATIONS)
@given(seed=st.integers(0, 2**20), size=st.sampled_from([1e-6, 1e-3, 1.0, 30.0]))
def test_whatever_a_network_says_is_a_rotation(name, seed, size):
    width, to_matrix = ROTATIONS[name]
    vector = size * torch.randn(5, width, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    turn = to_matrix(vector)
    torch.testing.assert_close(turn @ turn.mT, torch.eye(3, dtype=torch.float64).expand(5, 3, 3), atol=1e-6, rtol=0)
    torch.testing.assert_close(torch.linalg.det(turn), torch.ones(5, dtype=torch.float64))


def test_axis_angle_is_the_matrix_exponential_and_has_a_slope_at_none():
    vector = torch.tensor([[0.3, -1.2, 0.7], [1e-5, 2e-5, 0.0], [0.0, 0.0, 0.0]], dtype=torch.float64)
    x, y, z = vector.unbind(-1)
    o = torch.zeros_like(x)
    cross = torch.stack([o, -z, y, z, o, -x, -y, x, o], -1).unflatten(-1, (3, 3))
    torch.testing.assert_close(from_axis_angle(vector), torch.linalg.matrix_exp(cross), atol=1e-9, rtol=0)
    vector.requires_grad_()
    from_axis_angle(vector)[:, 2, 1].sum().backward()
    np.testing.assert_allclose(vector.grad[2].numpy(), [1, 0, 0], atol=1e-9)
