import numpy as np
import pytest
import torch

from pec.pose.distance import PoseDistance, add, add_s
from tests.pec.pose.conftest import about_z, random_pose


def gap(models, estimate: np.ndarray, truth: np.ndarray, m: int) -> float:
    """PoseDistance of one pose, m."""
    centre = torch.from_numpy(estimate[:3, :3] @ models.centres[m] + estimate[:3, 3]).float()
    turn, true = (torch.from_numpy(each).float() for each in (estimate[:3, :3], truth))
    distance = PoseDistance.of(models)(centre[None, None], turn[None, None], true[None], torch.tensor([m]))
    return float(distance) * models.radii[m]


def test_it_is_the_root_mean_square_over_the_points(models):
    rng = np.random.default_rng(0)
    estimate, truth = random_pose(rng), random_pose(rng)
    points = models.points[0].astype(float)
    apart = points @ (estimate[:3, :3] - truth[:3, :3]).T + estimate[:3, 3] - truth[:3, 3]
    assert gap(models, estimate, truth, 0) == pytest.approx(np.sqrt((apart**2).sum(axis=1).mean()), rel=1e-4)


@pytest.mark.parametrize("turn", [*about_z(np.deg2rad([0, 40, 250])), np.diag([1.0, -1, -1, 1])])
def test_a_pose_that_looks_alike_is_right_and_another_is_not(models, turn):
    truth = random_pose(np.random.default_rng(1))
    alike = truth @ turn
    assert gap(models, alike, truth, 1) < 1e-5
    assert add(alike, truth, models.points[1].astype(float), models.symmetries[1].astype(float)) < 1e-6
    if not np.allclose(turn, np.eye(4)):  # the hook has no symmetry
        assert gap(models, alike, truth, 0) > 0.02
        assert add(alike, truth, models.points[0].astype(float), models.symmetries[0].astype(float)) > 0.02


def test_of_a_shift_every_figure_is_its_length_or_less(models):
    truth = np.eye(4)
    estimate = np.eye(4)
    estimate[2, 3] = 0.004
    points = models.points[0].astype(float)
    assert gap(models, estimate, truth, 0) == pytest.approx(0.004, rel=1e-3)
    assert add(estimate, truth, points, np.eye(4)[None]) == pytest.approx(0.004)
    assert 0 < add_s(estimate, truth, points) < 0.004


def test_a_slope_leads_to_the_nearest_of_the_poses_that_look_alike(models):
    truth = torch.eye(4)[None]
    off = torch.from_numpy(about_z(np.deg2rad([37.0]))[0, :3, :3]).float()
    shift = torch.tensor([[[0.0, 0.0, 0.01]]], requires_grad=True)
    centre = torch.from_numpy(models.centres[1]).float() + shift
    PoseDistance.of(models)(centre, off[None, None], truth, torch.tensor([1])).sum().backward()
    assert shift.grad[0, 0, 2] > 0
