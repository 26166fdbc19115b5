"""What holds for every cloud: motion, order, density, and clouds that are none."""

import warnings

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, axis_angle, box_top, moved, pliers, standing_can
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from grasping import (
    CentroidPlanner,
    CloudError,
    CurvaturePlanner,
    GeoGraspPlanner,
    Grasp,
    GraspPlan,
    PublishedPlanner,
    SinglePrimitivePlanner,
)

PLANNERS = [CurvaturePlanner, PublishedPlanner, CentroidPlanner, GeoGraspPlanner, SinglePrimitivePlanner]


def odd_shape(seed: int) -> np.ndarray:
    """A few boxes on one another, without symmetry, and a millimetre of noise."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(3):
        length, width, height = *rng.uniform(0.02, 0.11, 2), rng.uniform(0.015, 0.08)
        part = box_top(length, width, height, step=0.005)
        angle = rng.uniform(0, np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        parts.append(part @ turn.T + [*rng.uniform(-0.03, 0.03, 2), 0.0])
    cloud = np.vstack(parts)
    cloud += rng.normal(scale=0.001, size=cloud.shape)
    return np.clip(cloud, [-1, -1, 0], 1)


def assert_same(first: GraspPlan, second: GraspPlan, T: np.ndarray, metres: float, radians: float) -> None:
    """The same best grasp after the motion T, up to the gripper's half turn about its approach."""
    assert (first.best is None) == (second.best is None)
    if first.best is None or second.best is None:
        return
    moved = T @ first.best.pose
    assert np.linalg.norm(moved[:3, 3] - second.best.pose[:3, 3]) < metres
    assert axis_angle(moved[:3, 0], second.best.pose[:3, 0]) < radians
    assert moved[:3, 2] @ second.best.pose[:3, 2] > np.cos(radians)
    assert first.best.width == pytest.approx(second.best.width, abs=metres)


def motion(seed: int) -> np.ndarray:
    """A turn, and so small a shift that no camera can stand in the origin, before or after it: nothing was seen."""
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    T[:3, 3] = np.random.default_rng(seed).uniform(-0.05, 0.05, 3)
    return T


@pytest.mark.parametrize("planner", PLANNERS, ids=lambda each: each.__name__)
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_rigid_motion_of_the_whole_scene_moves_the_grasp_along(planner: type, seed: int) -> None:
    cloud, T = odd_shape(seed), motion(seed)
    beside = moved(odd_shape(seed + 1), x=0.12, y=0.02)
    turned, turned_beside = cloud @ T[:3, :3].T + T[:3, 3], beside @ T[:3, :3].T + T[:3, 3]
    up = T[:3, 2]
    table = np.append(up, -up @ T[:3, 3])
    plan = planner().plan
    assert_same(plan(cloud, up=UP, table=TABLE), plan(turned, up=up, table=table), T, 1e-5, 1e-3)
    assert_same(plan(cloud, up=UP), plan(turned, up=up), T, 1e-5, 1e-3)
    if planner is not CentroidPlanner:  # which needs to know where up is
        assert_same(plan(cloud), plan(turned), T, 1e-5, 1e-3)
    crowded = plan(turned, up=up, table=table, obstacles=turned_beside)
    assert_same(plan(cloud, up=UP, table=TABLE, obstacles=beside), crowded, T, 1e-5, 1e-3)


@pytest.mark.parametrize("planner", PLANNERS, ids=lambda each: each.__name__)
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_order_of_the_points_does_not_matter_and_a_plan_can_be_repeated(planner: type, seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud, beside = odd_shape(seed), moved(odd_shape(seed + 1), x=0.12, y=0.02)
    scenes: list[dict] = [{"up": UP}, {"up": UP, "table": TABLE}, {"up": UP, "table": TABLE, "obstacles": beside}]
    for scene in scenes if planner is CentroidPlanner else [{}, *scenes]:
        other = {**scene, "obstacles": rng.permutation(beside)} if "obstacles" in scene else scene
        first = planner().plan(cloud, **scene)
        assert_same(first, planner().plan(rng.permutation(cloud), **other), np.eye(4), 1e-6, 1e-6)
        again = planner().plan(cloud.copy(), **scene)
        assert first.reason == again.reason
        for one, two in zip(first.candidates, again.candidates, strict=True):
            np.testing.assert_array_equal(one.pose, two.pose)
            assert (one.width, one.score, one.terms) == (two.width, two.score, two.terms)
        for region, same in zip(first.regions, again.regions, strict=True):
            np.testing.assert_array_equal(region.points, same.points)
            assert (region.verdict, region.width, region.curvature) == (same.verdict, same.width, same.curvature)


def changed(cloud: np.ndarray, seed: int) -> list[np.ndarray]:
    """The cloud with a millimetre of noise, and half of it."""
    rng = np.random.default_rng(seed)
    return [cloud + rng.normal(scale=0.001, size=cloud.shape), rng.permutation(cloud)[: len(cloud) // 2]]


def best_on_table(cloud: np.ndarray) -> Grasp:
    grasp = CurvaturePlanner().plan(cloud, up=UP, table=TABLE).best
    assert grasp is not None
    return grasp


STEADY = {
    "box": box_top(0.15, 0.05, 0.06),
    "flat": box_top(0.16, 0.03, 0.012),
    "long": box_top(0.28, 0.04, 0.04),
    "can": standing_can(0.033, 0.1),
    "tall": standing_can(0.03, 0.25),
    "pliers": pliers(),
}


def test_noise_and_half_of_the_points_leave_the_best_grasp_where_it_is() -> None:
    far, turns, widths = [], [], []
    for name, cloud in STEADY.items():
        reference = best_on_table(cloud)
        for grasp in (best_on_table(other) for seed in range(8) for other in changed(cloud, seed)):
            far.append(np.linalg.norm(grasp.pose[:3, 3] - reference.pose[:3, 3]))
            widths.append(abs(grasp.width - reference.width))
            if name not in ("can", "tall"):  # which are held alike from every side
                turns.append(axis_angle(grasp.pose[:3, 0], reference.pose[:3, 0]))
    for changes, half, nearly_all in (
        (far, 0.005, 0.015),
        (turns, np.deg2rad(5), np.deg2rad(10)),
        (widths, 0.004, 0.008),
    ):
        assert np.median(changes) < half
        assert np.mean(np.array(changes) < nearly_all) >= 0.95


def test_of_two_ends_that_are_alike_either_may_be_best_and_the_other_is_a_candidate_nearly_as_good() -> None:
    # Only the ends can be held: the plate between them is wider than the gripper opens.
    plate = box_top(0.16, 0.16, 0.03, step=0.004, bottom=False)
    plate = plate[np.hypot(plate[:, 0], plate[:, 1]) < 0.08]
    end = box_top(0.07, 0.03, 0.03, step=0.002)
    cloud = np.vstack([plate, moved(end, x=0.115), moved(end, x=-0.115)])
    others = 0
    clouds = [other for seed in range(5) for other in changed(cloud, seed)]
    for other in clouds:
        plan = CurvaturePlanner().plan(other, up=UP, table=TABLE)
        assert plan.best is not None
        assert 0.085 < abs(plan.best.pose[0, 3]) < 0.125
        away = [grasp.score for grasp in plan.candidates if grasp.pose[0, 3] * plan.best.pose[0, 3] < -(0.08**2)]
        others += bool(away) and max(away) > plan.best.score - 0.03
    assert others >= 0.8 * len(clouds)


def line(count: int = 50) -> np.ndarray:
    return np.linspace(0, 0.1, count)[:, None] * [1.0, 1.0, 0.5]


HOSTILE = {
    "empty": np.empty((0, 3)),
    "one point": np.zeros((1, 3)),
    "one-dimensional": np.zeros(30),
    "two columns": np.zeros((30, 2)),
    "images": np.zeros((5, 5, 3)),
    "text": np.array([["a", "b", "c"]] * 20),
    "objects": np.array([[None, 1, 2]] * 20, dtype=object),
    "complex": np.ones((20, 3)) * 1j,
    "NaN": np.vstack([line(), [[np.nan, 0, 0]]]),
    "infinity": np.vstack([line(), [[np.inf, 0, 0]]]),
    "far away": line() + 1e9,
    "millimetres": line() * 1e5,
}


@pytest.mark.parametrize(
    "planner", [CurvaturePlanner(), PublishedPlanner(), CentroidPlanner()], ids=lambda p: type(p).__name__
)
@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_no_cloud_is_refused_by_name(planner: CurvaturePlanner, name: str) -> None:
    with pytest.raises(CloudError, match="points"):
        planner.plan(HOSTILE[name], up=UP)


ODD = {
    "all the same": np.zeros((40, 3)),
    "collinear": line(),
    "vertical": np.linspace(0, 0.1, 50)[:, None] * [0.0, 0.0, 1.0],
    "coplanar": np.random.default_rng(0).uniform(0, 0.1, (200, 3)) * [1, 1, 0],
    "upright plane": np.random.default_rng(0).uniform(0, 0.1, (200, 3)) * [1, 0, 1],
    "duplicates": np.repeat(line(12), 20, axis=0),
    "integers": np.random.default_rng(0).integers(0, 2, (60, 3)),
    "Fortran order": np.asfortranarray(box_top(0.1, 0.05, 0.05)),
    "float16": box_top(0.1, 0.05, 0.05).astype(np.float16),
    "far and near": np.vstack([box_top(0.05, 0.05, 0.05), [[1.5, 0, 0.02]]]),
    "below the table": box_top(0.1, 0.05, 0.05) - [0, 0, 0.2],
    "list": box_top(0.1, 0.05, 0.05).tolist(),
}


def assert_sound(plan: GraspPlan) -> None:
    assert (plan.best is None) == (plan.reason is not None)
    for grasp in plan.candidates:
        assert np.isfinite(grasp.pose).all()
        assert np.isfinite(list(grasp.terms.values())).all()
        np.testing.assert_allclose(grasp.pose[:3, :3] @ grasp.pose[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(grasp.pose[:3, :3]) > 0
        assert 0.0 <= grasp.width <= 0.140


@pytest.mark.parametrize("planner", [CurvaturePlanner(), PublishedPlanner()], ids=lambda p: type(p).__name__)
@pytest.mark.parametrize("name", ODD)
def test_an_odd_cloud_ends_in_a_plan_or_a_reason_without_a_warning(planner: CurvaturePlanner, name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_sound(planner.plan(ODD[name], up=UP, table=TABLE))
        assert_sound(planner.plan(ODD[name], up=UP))
        assert_sound(planner.plan(ODD[name]))
        assert_sound(planner.plan(ODD[name], up=UP, table=TABLE, obstacles=ODD["coplanar"] + [0.06, 0, 0.02]))


def test_a_read_only_cloud_is_left_alone() -> None:
    cloud = box_top(0.1, 0.05, 0.05)
    cloud.flags.writeable = False
    before = cloud.copy()
    assert CurvaturePlanner().plan(cloud, up=UP, table=TABLE).best is not None
    np.testing.assert_array_equal(cloud, before)


@settings(max_examples=100, deadline=None)
@given(
    arrays(
        np.float32,
        st.tuples(st.integers(0, 60), st.just(3)),
        elements=st.floats(-2, 2, width=32)
        | st.sampled_from([0.0, 0.01, 1e-30, np.float32(np.nan), np.float32(np.inf)]),
    ),
    st.booleans(),
)
def test_any_numbers_end_in_a_plan_a_reason_or_a_typed_error(cloud: np.ndarray, on_table: bool) -> None:
    scene = {"up": UP, "table": TABLE} if on_table else {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for planner in (CurvaturePlanner(), PublishedPlanner()):
            try:
                plan = planner.plan(cloud, **scene)
            except CloudError:
                continue
            assert_sound(plan)
