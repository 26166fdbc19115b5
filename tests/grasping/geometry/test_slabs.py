"""Axes, slabs, clusters and primitives on clouds whose answer is known."""

import numpy as np
from grasping_shapes import grid, whole_cylinder
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist, pdist
from scipy.spatial.transform import Rotation

from grasping.geometry.clustering import euclidean_clusters, voxel_clusters
from grasping.geometry.primitives import all_alike, primitive_of
from grasping.geometry.principal_axes import object_axes, principal_axes
from grasping.geometry.sampling import spread
from grasping.geometry.slabs import slab_of


def test_object_axes_are_right_handed_with_y_along_the_object() -> None:
    cloud = grid((-0.1, 0.1), (-0.03, 0.03), (-0.01, 0.012), step=0.01)
    axes = object_axes(cloud)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) > 0
    assert abs(axes[0, 1]) > 0.999
    assert abs(axes[1, 0]) > 0.999


@given(st.integers(0, 1000))
def test_axes_turn_with_the_object(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = rng.gamma(2.0, size=(50, 3)) * [3.0, 2.0, 1.0]
    turn = Rotation.random(random_state=seed).as_matrix()
    np.testing.assert_allclose(principal_axes(cloud @ turn.T + seed), turn @ principal_axes(cloud), atol=1e-6)


def test_what_the_slabs_leave_is_at_both_ends_at_the_lower_end_or_a_slab() -> None:
    y = np.array([0.0, 0.2, 0.5, 1.0, 1.5, 2.0, 2.25, 2.5])
    assert slab_of(y, 1.0, "last slab").tolist() == [2, 2, 2, 1, 1, 0, 0, 0]
    assert slab_of(y, 1.0, "lower end").tolist() == [-1, -1, -1, 1, 1, 0, 0, 0]
    assert slab_of(y, 1.0, "both ends").tolist() == [-1, -1, 1, 1, 0, 0, 0, -1]


def test_spread_points_cover_the_cloud_as_closely_as_they_are_apart() -> None:
    cloud = np.random.default_rng(0).uniform(size=(200, 3))
    chosen = spread(cloud, 50)
    assert len(np.unique(chosen, axis=0)) == 50
    away = cdist(cloud, chosen).min(axis=1)
    assert np.count_nonzero(away == 0.0) == 50
    gap = pdist(chosen).min()
    assert away.max() <= gap
    assert gap > 2 * pdist(cloud[:50]).min()
    assert len(spread(cloud, 300)) == 200


def test_clusters_split_where_the_gap_exceeds_the_tolerance() -> None:
    x = np.array([0.0, 0.01, 0.02, 0.05, 0.06, 0.3])
    cloud = np.column_stack([x, 0 * x, 0 * x])
    assert euclidean_clusters(cloud, 0.015).tolist() == [0, 0, 0, 1, 1, 2]
    assert len(set(euclidean_clusters(cloud, 0.031))) == 2
    assert voxel_clusters(cloud, 0.015).tolist() == [0, 0, 0, 1, 1, 2]


def test_primitives_follow_the_share_of_flat_neighbourhoods() -> None:
    flat, curved = [0.001], [0.05]
    assert primitive_of(np.array(flat * 5 + curved * 95)) == "sphere"
    assert primitive_of(np.array(flat * 20 + curved * 80)) == "cylinder"
    assert primitive_of(np.array(flat * 60 + curved * 40)) == "box"


def test_regions_are_alike_only_in_primitive_and_length() -> None:
    assert all_alike(["box", "box"], [0.05, 0.055], 0.008)
    assert not all_alike(["box", "box"], [0.05, 0.06], 0.008)
    assert not all_alike(["box", "cylinder"], [0.05, 0.05], 0.008)


def test_a_whole_cylinder_has_its_axis_along_y() -> None:
    axes = object_axes(whole_cylinder(0.03, 0.2))
    assert abs(axes[1, 1]) > 0.99
