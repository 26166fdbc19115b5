"""Surface variation against a plain eigenvalue routine and against its closed form on known surfaces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from grasping.geometry.surface_variation import covariances, smallest_eigenvalue_share, surface_variation, variation_at


def reference_share(covariance: np.ndarray) -> float:
    values = np.linalg.eigvalsh(covariance)
    return float(values[0] / values.sum()) if values.sum() > 0 else 0.0


@given(arrays(np.float64, (5, 8, 3), elements=st.floats(-1, 1, width=32)))
def test_closed_form_agrees_with_the_eigenvalue_routine(neighbourhoods: np.ndarray) -> None:
    fast = smallest_eigenvalue_share(covariances(neighbourhoods))
    slow = [reference_share(np.cov(points.T, bias=True)) for points in neighbourhoods]
    np.testing.assert_allclose(fast, np.clip(slow, 0, 1 / 3), atol=1e-7)


def test_known_values() -> None:
    rng = np.random.default_rng(0)
    disc = rng.uniform(-1, 1, (2000, 3)) * [1, 1, 0]
    assert surface_variation(disc, 20).max() < 1e-12
    assert smallest_eigenvalue_share(np.eye(3)[None])[0] == pytest.approx(1 / 3)
    assert smallest_eigenvalue_share(np.zeros((1, 3, 3)))[0] == 0.0


@pytest.mark.parametrize(("sphere", "factor"), [(False, 32), (True, 24)])
def test_a_small_patch_follows_the_closed_form(sphere: bool, factor: int) -> None:
    radius, patch = 0.05, 0.01
    rng = np.random.default_rng(1)
    xy = rng.uniform(-patch, patch, (20_000, 2))
    xy = xy[np.hypot(*xy.T) < patch]
    squared = (xy**2).sum(axis=1) if sphere else xy[:, 0] ** 2
    points = np.column_stack([xy, np.sqrt(radius**2 - squared)])
    sigma = variation_at(points, np.array([[0, 0, radius]]), len(points))[0]
    assert sigma == pytest.approx(patch**2 / (factor * radius**2), rel=0.05)


def test_too_few_neighbours_have_no_curvature() -> None:
    assert variation_at(np.zeros((2, 3)), np.zeros((1, 3)), 5).tolist() == [0.0]
