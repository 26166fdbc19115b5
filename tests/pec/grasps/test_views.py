"""What the networks see of a grasp: known places between the fingers, known pixels, known distances."""

import numpy as np
import pytest
import torch

from pec.errors import ConfigError
from pec.grasps.clouds import spread_points, surface_normals
from pec.grasps.hand import Hand
from pec.grasps.networks.gpd import projected_images
from pec.grasps.views import between_fingers, first_of, in_grasp_frame, unless_nothing

HAND = Hand()


def test_points_come_into_the_frame_of_the_grasp(downward) -> None:
    pose = torch.from_numpy(downward(np.pi / 2, np.array([0.1, 0.2, 0.3]))).float()[None]
    points = torch.tensor([[[0.1, 0.2, 0.3], [0.1, 0.25, 0.3], [0.1, 0.2, 0.28]]])
    expected = [[0.0, 0.0, 0.0], [0.05, 0.0, 0.0], [0.0, 0.0, 0.02]]
    torch.testing.assert_close(in_grasp_frame(points, pose)[0], torch.tensor(expected), atol=1e-6, rtol=0)


def test_between_the_fingers_is_from_pad_to_pad_and_from_palm_to_tips() -> None:
    inside = [[0.069, 0.0, 0.0], [0.0, 0.013, 0.032], [0.0, 0.0, -0.104]]
    outside = [[0.071, 0.0, 0.0], [0.0, 0.014, 0.0], [0.0, 0.0, 0.033], [0.0, 0.0, -0.105]]
    found = between_fingers(torch.tensor([inside + outside]), HAND)[0].tolist()
    assert found == [True] * 3 + [False] * 4


def test_the_first_points_inside_are_taken_and_repeated_where_there_are_fewer() -> None:
    local = torch.arange(12.0).view(1, 4, 3).repeat(2, 1, 1)
    inside = torch.tensor([[False, True, False, True], [False] * 4])
    taken = first_of(local, inside, 3)
    assert taken[0, :, 0].tolist() == [3.0, 9.0, 3.0]
    assert not taken[1].any()
    assert first_of(local, inside, 1)[0, :, 0].tolist() == [3.0]


def test_what_has_nothing_between_the_fingers_is_not_likely_to_hold() -> None:
    inside = torch.zeros(2, 20, dtype=torch.bool)
    inside[0, :8] = True
    assert unless_nothing(torch.tensor([3.0, 3.0]), inside).tolist() == [3.0, -4.0]


def test_a_point_falls_on_one_pixel_of_each_picture() -> None:
    """At the middle of the volume but for x, a quarter of it from the low side."""
    low, high = HAND.low, HAND.high
    point = low + torch.tensor([0.26, 0.51, 0.76]) * (high - low)
    local, normals = point.expand(1, 2, 3).clone(), torch.tensor([[[-1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]])
    inside = torch.tensor([[True, True]])
    images = projected_images(local, normals, inside, HAND, 4)[0]
    assert images.shape == (12, 4, 4)
    heights = images[[0, 4, 8]]
    for image, (row, column), height in zip(heights, ((1, 2), (1, 3), (2, 3)), (0.76, 0.51, 0.26), strict=True):
        assert image[row, column].item() == pytest.approx(height, abs=1e-5)
        assert int((image > 0).sum()) == 1
    torch.testing.assert_close(images[1:4, 1, 2], torch.tensor([0.5, 0.3, 0.4]))
    assert not projected_images(local, normals, ~inside, HAND, 4).any()


def test_normals_of_a_plane_are_its_own() -> None:
    rng = np.random.default_rng(0)
    flat = rng.uniform(-0.05, 0.05, (200, 3)) * (1.0, 1.0, 0.0)
    normals = surface_normals(torch.from_numpy(flat).float())
    torch.testing.assert_close(normals[:, 2].abs(), torch.ones(200), atol=1e-4, rtol=0)


def test_spread_points_stay_where_they_are() -> None:
    cloud = np.random.default_rng(0).uniform(0.4, 0.5, (300, 3)).astype(np.float32)
    spread = spread_points(cloud, 64)
    assert np.abs(spread[:, None] - cloud[None]).sum(axis=2).min(axis=1).max() < 1e-5
    few = spread_points(cloud[:20], 64)
    assert len(np.unique(few.round(5), axis=0)) == 20


def test_a_hand_has_the_measures_of_a_hand() -> None:
    assert HAND.outline().shape == (16, 3)
    assert HAND.control_points()[:, 0].abs().max().item() == pytest.approx(0.07)
    with pytest.raises(ConfigError, match=r"hand\.stroke"):
        Hand(stroke=-0.1)
