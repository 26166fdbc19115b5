"""A pose comes out right however the cloud's own frame was turned: shown with networks that have learnt nothing yet."""

import numpy as np
import pytest
import torch

from pec.pose.distance import PoseDistance
from pec.pose.hypotheses import all_views, hypotheses
from pec.pose.network import NetworkConfig, PoseNetwork
from pec.pose.view_frame import principal_frame, sight_frame
from tests.pec.pose.conftest import random_pose, seen


@pytest.fixture
def cloud(models) -> torch.Tensor:
    return torch.from_numpy(seen(models.points[0], random_pose(np.random.default_rng(3))))[:96][None]


def turn_about_the_camera(seed: int) -> torch.Tensor:
    return torch.from_numpy(random_pose(np.random.default_rng(seed))[:3, :3]).float()


@pytest.mark.parametrize(("frame", "turn"), [(sight_frame, 0.7), (principal_frame, 2)])
def test_a_view_frame_is_a_pose_that_takes_the_points_back(cloud, frame, turn):
    seen_points, T_camera_view = frame(cloud, torch.tensor([turn]))
    back = seen_points @ T_camera_view[:, :3, :3].mT + T_camera_view[:, None, :3, 3]
    torch.testing.assert_close(back, cloud, atol=1e-6, rtol=0)
    torch.testing.assert_close(torch.linalg.det(T_camera_view[:, :3, :3]), torch.ones(1))


def test_the_line_of_sight_is_the_z_axis(cloud):
    _, T_camera_view = sight_frame(cloud, torch.tensor([1.3]))
    torch.testing.assert_close(
        T_camera_view[0, :3, 2], torch.nn.functional.normalize(cloud[0].mean(0), dim=0), atol=1e-6, rtol=0
    )


def test_what_the_camera_sees_turned_is_said_turned(models, cloud):
    """In the principal frame by itself; the four views together are the same four."""
    network = PoseNetwork(NetworkConfig(n_points=32), 2).eval()
    distance, model = PoseDistance.of(models), torch.tensor([0])
    turn = turn_about_the_camera(4)
    with torch.no_grad():
        said = all_views(network, distance, cloud, model)
        turned = all_views(network, distance, cloud @ turn.mT, model)
    apart = torch.cdist(said.centre[0] @ turn.mT, turned.centre[0]).min(dim=1).values
    assert said.centre.shape == (1, 16, 3)
    assert apart.max() < 1e-4


def test_poses_put_the_models_centre_where_it_was_said_to_be(models, cloud):
    network = PoseNetwork(NetworkConfig(n_points=32, encoder="pointnet", hypotheses=3), 2).eval()
    distance, model = PoseDistance.of(models), torch.tensor([0])
    said = hypotheses(network, distance, cloud, model, torch.tensor([0.2]))
    poses = said.poses(distance.centres[model])
    centre = (poses[0, :, :3, :3] @ distance.centres[0] + poses[0, :, :3, 3]).detach()
    torch.testing.assert_close(centre, said.centre[0].detach(), atol=1e-6, rtol=0)


@pytest.mark.parametrize("rotation", ["axis_angle", "quaternion", "6d"])
def test_cloudposes_form_has_two_networks_and_one_hypothesis(models, cloud, rotation):
    config = NetworkConfig(32, "pointnet", rotation, hypotheses=1, two_branches=True)
    network = PoseNetwork(config, 2).eval()
    said = hypotheses(network, PoseDistance.of(models), cloud, torch.tensor([1]), torch.zeros(1))
    assert (said.centre.shape, said.rotation.shape) == ((1, 1, 3), (1, 1, 3, 3))
    said.centre.sum().backward()
    position, rotation = (sum(p.grad.abs().sum() for p in encoder.parameters()) for encoder in network.encoders)
    assert position > 0
    assert rotation == 0
