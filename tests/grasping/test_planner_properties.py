"""What holds for every cloud: motion, order, density, and clouds that are none."""

import warnings

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, axis_angle, box_top, pliers, standing_can
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from grasping import CentroidPlanner, CloudError, CurvaturePlanner, GraspPlan, PublishedPlanner


def odd_shape(seed: int) -> np.ndarray:
    """A few boxes on one another, without symmetry, and a millimetre of noise."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(3):
        part = box_top(*rng.uniform(0.02, 0.11, 2), rng.uniform(0.015, 0.08), step=0.005)
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


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_a_rigid_motion_moves_the_grasp_along(seed: int) -> None:
    cloud = odd_shape(seed)
    rng = np.random.default_rng(seed + 1)
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    T[:3, 3] = rng.uniform(-1, 1, 3)
    turned = cloud @ T[:3, :3].T + T[:3, 3]
    up = T[:3, 2]
    table = np.append(up, -up @ T[:3, 3])
    planner = CurvaturePlanner()
    on_table = planner.plan(turned, up=up, table=table)
    assert_same(planner.plan(cloud, up=UP, table=TABLE), on_table, T, 1e-5, 1e-3)
    assert_same(planner.plan(cloud), planner.plan(turned), T, 1e-5, 1e-3)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_the_order_of_the_points_does_not_matter_and_a_plan_can_be_repeated(seed: int) -> None:
    cloud = odd_shape(seed)
    shuffled = cloud[np.random.default_rng(seed).permutation(len(cloud))]
    for planner in (CurvaturePlanner(), PublishedPlanner(), CentroidPlanner()):
        first = planner.plan(cloud, up=UP, table=TABLE)
        assert_same(first, planner.plan(shuffled, up=UP, table=TABLE), np.eye(4), 1e-6, 1e-6)
        again = planner.plan(cloud, up=UP, table=TABLE)
        assert first.reason == again.reason
        for one, other in zip(first.candidates, again.candidates, strict=True):
            np.testing.assert_array_equal(one.pose, other.pose)


@pytest.mark.parametrize("cloud", [box_top(0.16, 0.05, 0.04), standing_can(0.035, 0.1), pliers()])
def test_half_of_the_points_and_a_millimetre_of_noise_hardly_change_the_grasp(cloud: np.ndarray) -> None:
    reference = CurvaturePlanner().plan(cloud, up=UP, table=TABLE).best
    assert reference is not None
    for seed in range(10):
        rng = np.random.default_rng(seed)
        half = cloud[rng.permutation(len(cloud))[: len(cloud) // 2]]
        noisy = half + rng.normal(scale=0.001, size=half.shape)
        grasp = CurvaturePlanner().plan(noisy, up=UP, table=TABLE).best
        assert grasp is not None
        assert abs(grasp.width - reference.width) < 0.008
        assert np.linalg.norm(grasp.pose[:3, 3] - reference.pose[:3, 3]) < 0.03


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


def test_a_million_points_are_planned_on() -> None:
    rng = np.random.default_rng(0)
    cloud = box_top(0.15, 0.05, 0.06)
    cloud = cloud[rng.integers(0, len(cloud), 1_000_000)] + rng.normal(scale=5e-4, size=(1_000_000, 3))
    assert CurvaturePlanner().plan(cloud, up=UP, table=TABLE).best is not None


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
