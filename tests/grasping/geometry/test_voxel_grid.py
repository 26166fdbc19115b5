"""The voxel grid: which cube each point is in, and the mean of each cube."""

import numpy as np

from grasping.geometry.voxel_grid import cube_means, cubes


def test_points_of_one_cube_have_one_number_and_their_mean() -> None:
    points = np.array([[0.0001, 0, 0], [0.0019, 0, 0], [0.0021, 0, 0], [-0.0001, 0, 0]])
    numbers = cubes(points, 0.002)
    assert numbers.tolist() == [1, 1, 2, 0]
    np.testing.assert_allclose(cube_means(points, numbers), [[-0.0001, 0, 0], [0.001, 0, 0], [0.0021, 0, 0]])


def test_each_occupied_cube_is_counted_once_and_its_mean_lies_in_it() -> None:
    cloud = np.random.default_rng(0).uniform(-0.1, 0.1, (5000, 3))
    means = cube_means(cloud, cubes(cloud, 0.01))
    np.testing.assert_array_equal(np.floor(means / 0.01), np.unique(np.floor(cloud / 0.01), axis=0))
