"""What holds for the published planner, each rival and each cloud: motion, order, repetition, and what is no cloud."""

import warnings

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, axis_angle, box_top, standing_can
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasping import (
    CentroidPlanner,
    CloudError,
    ConfigError,
    GeoGraspPlanner,
    GraspPlan,
    PublishedPlanner,
    SinglePrimitivePlanner,
)

RIVALS = [PublishedPlanner(), CentroidPlanner(), GeoGraspPlanner(n_grasps=4), SinglePrimitivePlanner()]
Rival = PublishedPlanner | CentroidPlanner | GeoGraspPlanner | SinglePrimitivePlanner
each_rival = pytest.mark.parametrize("planner", RIVALS, ids=lambda planner: type(planner).__name__)


def lopsided(seed: int) -> np.ndarray:
    """Two boxes without a common symmetry, on the table, with a millimetre of noise."""
    rng = np.random.default_rng(seed)
    parts = []
    for size in rng.uniform(0.02, 0.09, (2, 3)):
        angle = rng.uniform(0, np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        parts.append(box_top(*size, step=0.005) @ turn.T + [*rng.uniform(-0.02, 0.02, 2), 0.0])
    cloud = np.vstack(parts)
    return cloud + rng.normal(scale=0.001, size=cloud.shape)


def assert_same(first: GraspPlan, second: GraspPlan, T: np.ndarray) -> None:
    assert first.reason == second.reason
    assert [region.primitive for region in first.regions] == [region.primitive for region in second.regions]
    assert len(first.candidates) == len(second.candidates)
    for one, other in zip(first.candidates, second.candidates, strict=True):
        np.testing.assert_allclose(T @ one.pose, other.pose, atol=1e-6)
        assert one.width == pytest.approx(other.width, abs=1e-7)
        assert one.score == pytest.approx(other.score, abs=1e-6)


@each_rival
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_rigid_motion_moves_the_grasps_along(planner: Rival, seed: int) -> None:
    cloud = lopsided(seed)
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    T[:3, 3] = np.random.default_rng(seed).uniform(-1, 1, 3)
    turned = cloud @ T[:3, :3].T + T[:3, 3]
    up = T[:3, 2]
    table = np.append(up, -up @ T[:3, 3])
    assert_same(planner.plan(cloud, up=UP, table=TABLE), planner.plan(turned, up=up, table=table), T)
    if not isinstance(planner, CentroidPlanner):
        assert_same(planner.plan(cloud), planner.plan(turned), T)


@each_rival
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_neither_the_order_of_the_points_nor_a_second_call_matters(planner: Rival, seed: int) -> None:
    cloud = lopsided(seed)
    shuffled = cloud[np.random.default_rng(seed).permutation(len(cloud))]
    first = planner.plan(cloud, up=UP, table=TABLE)
    assert_same(first, planner.plan(shuffled, up=UP, table=TABLE), np.eye(4))
    again = planner.plan(cloud, up=UP, table=TABLE)
    for one, other in zip(first.candidates, again.candidates, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)


def sound(plan: GraspPlan) -> bool:
    """Whether the plan has a grasp or else a reason, and whether its poses are poses that the gripper fits."""
    assert (plan.best is None) == (plan.reason is not None)
    for grasp in plan.candidates:
        assert np.isfinite(grasp.pose).all()
        assert np.isfinite(list(grasp.terms.values())).all()
        np.testing.assert_allclose(grasp.pose[:3, :3] @ grasp.pose[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(grasp.pose[:3, :3]) > 0
        assert 0.0 <= grasp.width <= 0.140
        assert 0.0 <= grasp.score <= 1.0
        assert grasp.region is None or 0 <= grasp.region < len(plan.regions)
    assert all(np.isfinite([region.width, region.curvature]).all() for region in plan.regions)
    return True


@each_rival
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), on_table=st.booleans())
def test_small_hostile_clouds_end_in_a_plan_or_a_reason_without_a_warning(
    planner: Rival, seed: int, on_table: bool
) -> None:
    """Thin, flat, tiny, coarse, with duplicates, far from the origin: 10 to 60 points."""
    rng = np.random.default_rng(seed)
    cloud = rng.normal(size=(rng.integers(10, 60), 3)) * 10.0 ** rng.uniform(-9, -0.7, 3) * rng.integers(0, 2, 3)
    if rng.random() < 0.3:
        cloud = np.round(cloud, 2)
    if rng.random() < 0.3:
        cloud[: len(cloud) // 2] = cloud[0]
    cloud = cloud + rng.uniform(-1, 1, 3) * 10.0 ** rng.uniform(-3, 3)
    scene = {"up": UP, "table": TABLE} if on_table else {"up": UP}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sound(planner.plan(cloud, **scene))
        if not isinstance(planner, CentroidPlanner):
            assert sound(planner.plan(cloud))


@each_rival
@pytest.mark.parametrize(
    "cloud",
    [
        np.empty((0, 3)),
        np.zeros((9, 3)),
        np.zeros((30, 2)),
        np.full((30, 3), np.nan),
        np.array([["a", "b", "c"]] * 20),
        np.linspace(0, 100, 60).reshape(20, 3),
    ],
    ids=["empty", "nine points", "two columns", "NaN", "text", "millimetres"],
)
def test_what_is_no_cloud_is_refused_by_name(planner: Rival, cloud: np.ndarray) -> None:
    with pytest.raises(CloudError, match="points"):
        planner.plan(cloud, up=UP)


@each_rival
def test_a_scene_that_makes_no_sense_is_refused_by_name(planner: Rival) -> None:
    cloud = standing_can(0.03, 0.1)
    with pytest.raises(ConfigError, match="up"):
        planner.plan(cloud, up=(0, 0, 0))
    with pytest.raises(ConfigError, match="table"):
        planner.plan(cloud, up=UP, table=(1, 0, 0))
    with pytest.raises(CloudError, match="obstacles"):
        planner.plan(cloud, up=UP, obstacles=np.zeros((3, 2)))


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (GeoGraspPlanner, "tip", 0.0),
        (GeoGraspPlanner, "n_points", 10),
        (GeoGraspPlanner, "n_grasps", 0),
        (GeoGraspPlanner, "tip_clearance", float("nan")),
        (SinglePrimitivePlanner, "n_points", 3),
        (SinglePrimitivePlanner, "neighbour_divisor", 0),
        (SinglePrimitivePlanner, "tip_clearance", -0.1),
        (CentroidPlanner, "tip_clearance", -0.1),
    ],
)
def test_a_parameter_that_makes_no_sense_is_named(kind: type, name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=name):
        kind(**{name: value})


@each_rival
def test_a_large_cloud_is_planned_on(planner: Rival) -> None:
    rng = np.random.default_rng(0)
    cloud = box_top(0.15, 0.05, 0.06)
    cloud = cloud[rng.integers(0, len(cloud), 100_000)] + rng.normal(scale=5e-4, size=(100_000, 3))
    best = planner.plan(cloud, up=UP, table=TABLE).best
    assert best is not None or isinstance(planner, SinglePrimitivePlanner)
    if best is not None and best.pose[2, 2] < -0.9:
        assert axis_angle(best.pose[:3, 0], np.array([0.0, 1.0, 0.0])) < 0.3
