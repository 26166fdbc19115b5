"""The level frame: z is up, the table is z = 0, and nothing is turned more than that."""

import numpy as np
import pytest

from grasping.geometry.level_frame import level_frame

CLOUD = np.array([[0.1, 0.2, 0.3], [0.2, 0.1, 0.5]])


def test_level_is_left_as_it_is() -> None:
    np.testing.assert_allclose(level_frame(CLOUD, np.array([0, 0, 1.0]), np.array([0, 0, 1.0, 0])), np.eye(4))


@pytest.mark.parametrize("up", [(0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (0.6, 0.0, 0.8), (1.0, 0.0, 0.0)])
def test_up_becomes_z_and_the_table_zero(up) -> None:
    normal = np.array(up)
    pose = level_frame(CLOUD, normal, np.append(normal, -0.25))
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(pose[:3, :3] @ normal, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(CLOUD @ pose[2, :3] + pose[2, 3], CLOUD @ normal - 0.25, atol=1e-12)


def test_without_a_table_the_lowest_point_is_zero() -> None:
    for up in (None, np.array([0.0, 1.0, 0.0])):
        pose = level_frame(CLOUD, up, None)
        assert (CLOUD @ pose[2, :3] + pose[2, 3]).min() == pytest.approx(0.0)
