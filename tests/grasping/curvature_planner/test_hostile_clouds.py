"""Ten thousand clouds that nobody would call one: each ends in a plan, a reason or a typed error, and none hangs."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, box_top, moved, pliers, standing_can

import grasping
from grasping import (
    ROBOTIQ_2F_140,
    CentroidPlanner,
    CloudError,
    ConfigError,
    CurvaturePlanner,
    GeoGraspPlanner,
    GraspPlan,
    PublishedPlanner,
    Scene,
    Segmenter,
    SinglePrimitivePlanner,
)

SHARES = {  # of the ten thousand
    CurvaturePlanner: 8000,
    PublishedPlanner: 700,
    CentroidPlanner: 500,
    GeoGraspPlanner: 300,
    SinglePrimitivePlanner: 300,
    Segmenter: 200,
}
PLANNERS = [each for each in SHARES if each is not Segmenter]
AT_MOST = 1.0 if grasping.compiled else 4.0  # s of processor time for one cloud; the slowest takes 0.25 s compiled
SLOWED = 5  # turns that a busy machine may spoil
Cloud = Any  # a hostile cloud may be of any type
Random = np.random.Generator
SHAPES = [box_top(0.15, 0.05, 0.06, step=0.006), standing_can(0.033, 0.1, step=0.006), pliers(step=0.004)]


def some_shape(rng: Random) -> np.ndarray:
    shape = SHAPES[rng.integers(len(SHAPES))]
    return shape[rng.integers(0, len(shape), rng.integers(1, 250))] + rng.normal(scale=0.001, size=3)


def few(rng: Random) -> np.ndarray:
    return rng.normal(scale=0.05, size=(rng.integers(0, 12), 3))


def blob(rng: Random) -> np.ndarray:
    return rng.normal(scale=10.0 ** rng.uniform(-4, -1), size=(rng.integers(10, 200), 3))


def flat(rng: Random) -> np.ndarray:
    """On a plane, a line or a point, along the axes or in any direction, exactly or nearly."""
    cloud = rng.uniform(-0.1, 0.1, (rng.integers(10, 200), 3))
    cloud[:, rng.permutation(3)[: rng.integers(1, 4)]] = 0.0
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return cloud @ (turn if rng.random() < 0.5 else np.eye(3)) + rng.choice([0.0, 1e-12, 1e-6]) * rng.normal(size=3)


def duplicates(rng: Random) -> np.ndarray:
    return np.repeat(some_shape(rng), rng.integers(2, 12), axis=0)


def lattice(rng: Random) -> np.ndarray:
    """Coordinates on a coarse grid: every comparison is a tie."""
    return np.round(some_shape(rng) / 0.01) * 0.01


def not_finite(rng: Random) -> np.ndarray:
    cloud = some_shape(rng)
    cloud[rng.integers(len(cloud)), rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf])
    return cloud


def far(rng: Random) -> np.ndarray:
    return some_shape(rng) + rng.normal(size=3) * 10.0 ** rng.uniform(0, 12)


def millimetres(rng: Random) -> np.ndarray:
    return some_shape(rng) * 1000.0


def tiny(rng: Random) -> np.ndarray:
    return some_shape(rng) * 10.0 ** rng.uniform(-320, -2)


def huge(rng: Random) -> np.ndarray:
    return some_shape(rng) * 10.0 ** rng.uniform(1, 308)


def outliers(rng: Random) -> np.ndarray:
    return np.vstack([some_shape(rng), rng.uniform(-0.9, 0.9, (rng.integers(1, 5), 3))])


def wide(rng: Random) -> np.ndarray:
    return rng.uniform(-1.0, 1.0, (rng.integers(10, 200), 3)) * rng.choice([0.0, 0.01, 0.1, 0.3, 1.0], 3)


def other_layout(rng: Random) -> np.ndarray:
    cloud = some_shape(rng)
    view = [
        lambda: np.asfortranarray(cloud),
        lambda: cloud[::-1],
        lambda: np.repeat(cloud, 2, axis=1)[:, ::2],
        lambda: cloud.astype(">f8"),
        lambda: cloud.astype(np.float16),
        lambda: cloud.astype(np.float32),
        lambda: cloud.astype(np.longdouble),
    ][rng.integers(7)]()
    view.flags.writeable = False
    return view


def other_type(rng: Random) -> Cloud:
    cloud = some_shape(rng)
    return [
        lambda: cloud.tolist(),
        lambda: (cloud * 20).astype(np.int64),
        lambda: (cloud * 20).astype(np.uint8),
        lambda: cloud > 0.01,
        lambda: cloud.astype(object),
        lambda: np.array([[None, 1, 2]] * 20, dtype=object),
        lambda: cloud.astype(str),
        lambda: cloud.astype(np.complex64),
        lambda: np.ma.masked_less(cloud, 0.0),
        lambda: None,
        lambda: "cloud.ply",
        lambda: {"points": cloud},
        lambda: [[0, 0, 0], [1, 2]],
        lambda: np.zeros(12, dtype=[("x", float), ("y", float), ("z", float)]),
        lambda: np.array(["2026-01-01"] * 30, dtype="M8[D]").reshape(10, 3),
        lambda: iter(cloud),
        lambda: 3.0,
    ][rng.integers(17)]()


def other_shape(rng: Random) -> np.ndarray:
    return np.zeros([(0,), (30,), (30, 2), (30, 4), (3, 30), (5, 6, 3), (0, 3), (0, 4), (1, 1, 1, 3)][rng.integers(9)])


KINDS: list[Callable[[Random], Cloud]] = [
    some_shape,
    few,
    blob,
    flat,
    duplicates,
    lattice,
    not_finite,
    far,
    millimetres,
    tiny,
    huge,
    other_layout,
    other_type,
    other_shape,
]

LARGE = [outliers, wide]  # take long, so are fewer


def kind_of(i: int) -> Callable[[Random], Cloud]:
    return LARGE[i // 50 % 2] if i % 50 == 0 else KINDS[i % len(KINDS)]


def scene_of(rng: Random) -> dict[str, Any]:
    """None, or up, table and obstacles, sometimes of the kind that no scene has."""
    up: list[Any] = [
        UP,
        (0, 0, 5),
        np.eye(3, dtype=np.float32)[2],
        (1, 0, 0),
        rng.normal(size=3),
        (0, 0, -1),
        (0, 0, 1e-300),
        (0, 0, 0),
        "up",
    ]
    table: list[Any] = [
        TABLE,
        TABLE,
        (0, 0, -2, 0),
        (0, 0, 1, -0.05),
        (0, 0, 1, 5.0),
        rng.normal(size=4),
        (0, 0, np.nan, 0),
        (1,),
    ]
    obstacles = [
        few(rng),
        flat(rng),
        wide(rng),
        moved(some_shape(rng), x=0.06),
        not_finite(rng),
        np.zeros((4, 2)),
    ]
    scene: dict[str, Any] = {}
    if rng.random() < 0.7:
        scene["up"] = up[0] if rng.random() < 0.6 else up[rng.integers(len(up))]
    if rng.random() < 0.6:
        scene["table"] = table[0] if rng.random() < 0.6 else table[rng.integers(len(table))]
    if rng.random() < 0.3:
        scene["obstacles"] = obstacles[rng.integers(len(obstacles))]
    return scene


def assert_sound(plan: GraspPlan) -> None:
    assert (plan.best is None) == (plan.reason is not None)
    assert plan.reason is None or len(plan.reason) > 10
    for grasp in plan.candidates:
        assert np.isfinite(grasp.pose).all()
        assert np.isfinite(grasp.score)
        assert np.isfinite(list(grasp.terms.values())).all()
        np.testing.assert_allclose(grasp.pose[:3, :3] @ grasp.pose[:3, :3].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(grasp.pose[:3, :3]) > 0
        np.testing.assert_array_equal(grasp.pose[3], [0, 0, 0, 1])
        assert 0.0 <= grasp.width <= ROBOTIQ_2F_140.stroke
    for region in plan.regions:
        assert np.isfinite([region.width, region.curvature]).all()
        assert region.verdict


def outcome_of(run: Callable[[], GraspPlan | Scene]) -> str:
    """What comes of it: a plan, a reason, a scene or a typed error's name; whatever else is raised goes through."""
    with warnings.catch_warnings(), np.errstate(divide="raise", over="raise", invalid="raise"):
        warnings.simplefilter("error")
        for _ in range(SLOWED):
            start = time.thread_time()
            try:
                found: GraspPlan | Scene | str = run()
            except (CloudError, ConfigError) as error:
                found = f"{type(error).__name__}: {error}"
            spent = time.thread_time() - start
            if spent < AT_MOST:
                break
    assert spent < AT_MOST
    if isinstance(found, str):
        assert len(found) > 25  # says more than its name
        return found.partition(":")[0]
    if isinstance(found, Scene):
        assert all(np.isfinite(points).all() for points in found.objects)
        assert found.plane is None or np.isfinite(found.plane).all()
        return "scene"
    assert_sound(found)
    return "plan" if found.best is not None else "reason"


@pytest.mark.parametrize("tested", SHARES, ids=lambda each: each.__name__)
def test_a_hostile_cloud_ends_in_a_plan_a_reason_or_a_typed_error(tested: type) -> None:
    count = SHARES[tested]
    rng = np.random.default_rng([0, *tested.__name__.encode()])
    outcomes: Counter[str] = Counter()
    subject = tested()
    for i in range(count):
        kind = kind_of(i)
        cloud, scene = kind(rng), scene_of(rng)
        run = partial(subject.segment if tested is Segmenter else subject.plan, cloud)
        if tested is Segmenter:
            scene = {"up": scene["up"]} if "up" in scene else {}
        try:
            outcomes[outcome_of(partial(run, **scene))] += 1
        except Exception as error:
            raise AssertionError(f"cloud {i}, {kind.__name__}, of {tested.__name__}") from error
    likely = ("scene", "CloudError") if tested is Segmenter else ("plan", "CloudError", "ConfigError")
    assert min(outcomes[name] for name in likely) >= count // 50


@pytest.mark.parametrize("tested", SHARES, ids=lambda each: each.__name__)
def test_a_million_points_are_taken(tested: type) -> None:
    rng = np.random.default_rng(0)
    cloud = box_top(0.15, 0.05, 0.06)
    cloud = cloud[rng.integers(0, len(cloud), 1_000_000)] + rng.normal(scale=5e-4, size=(1_000_000, 3))
    outcome = outcome_of(partial(tested().segment if tested is Segmenter else tested().plan, cloud, up=UP))
    assert outcome == ("scene" if tested is Segmenter else "plan")


@pytest.mark.parametrize("cloud", [np.zeros((1_000_000, 3)), np.full((1_000_000, 3), np.nan)], ids=["zeros", "NaN"])
def test_a_million_useless_points_are_refused(cloud: np.ndarray) -> None:
    assert outcome_of(partial(CurvaturePlanner().plan, cloud, up=UP, table=TABLE)) in ("reason", "CloudError")


@pytest.mark.parametrize("tested", PLANNERS, ids=lambda each: each.__name__)
def test_millimetres_and_another_frames_coordinates_are_asked_about(tested: type) -> None:
    cloud = box_top(0.12, 0.05, 0.06)
    with pytest.raises(CloudError, match=r"spans 120 m.*millimetres"):
        tested().plan(cloud * 1000, up=UP)
    with pytest.raises(CloudError, match="beyond 10000 m"):
        tested().plan(cloud + 1e9, up=UP)


@pytest.mark.parametrize("height", [-5.0, 5.0, 1e6])
def test_a_table_far_from_the_object_is_asked_about(height: float) -> None:
    with pytest.raises(ConfigError, match="another frame or unit"):
        CurvaturePlanner().plan(box_top(0.1, 0.05, 0.06), up=UP, table=(0, 0, 1, -height))
