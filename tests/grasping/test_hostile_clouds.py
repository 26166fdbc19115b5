"""Ten thousand clouds that nobody would call one: each ends in a plan, a reason or a typed error, and soon."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, box_top, pliers, standing_can

from grasping import (
    ROBOTIQ_2F_140,
    CentroidPlanner,
    CloudError,
    ConfigError,
    CurvaturePlanner,
    GraspPlan,
    PublishedPlanner,
    Segmenter,
)

CLOUDS = 10_000
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
    return rng.uniform(-1.0, 1.0, (rng.integers(10, 200), 3)) * rng.choice([0.0, 0.01, 0.3, 1.0], 3)


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
    outliers,
    wide,
    other_layout,
    other_type,
    other_shape,
]


def scene_of(rng: Random) -> dict[str, Any]:
    """None, or up, table and obstacles, sometimes of the kind that no scene has."""
    up = [UP, (0, 0, 5), np.float32(UP), (1, 0, 0), rng.normal(size=3), (0, 0, -1), (0, 0, 1e-300), (0, 0, 0), "up"]
    table = [TABLE, TABLE, (0, 0, -2, 0), (0, 0, 1, -0.05), (0, 0, 1, 5.0), rng.normal(size=4), (0, 0, np.nan, 0), (1,)]
    obstacles = [few(rng), flat(rng), wide(rng), some_shape(rng) + [0.06, 0, 0], not_finite(rng), np.zeros((4, 2))]
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


def outcome_of(plan: Callable[[], GraspPlan]) -> str:
    """ "plan", "reason" or the name of a typed error; whatever else is raised, warnings included, goes through."""
    with warnings.catch_warnings(), np.errstate(divide="raise", over="raise", invalid="raise"):
        warnings.simplefilter("error")
        start = time.thread_time()
        try:
            found = plan()
        except (CloudError, ConfigError) as error:
            assert len(str(error)) > 10
            return type(error).__name__
        finally:
            spent = time.thread_time() - start
    assert spent < 1.0
    assert_sound(found)
    return "plan" if found.best is not None else "reason"


def test_ten_thousand_hostile_clouds_end_in_a_plan_a_reason_or_a_typed_error() -> None:
    rng = np.random.default_rng(0)
    default, others = CurvaturePlanner(), [PublishedPlanner(), CentroidPlanner()]
    outcomes: Counter[str] = Counter()
    for i in range(CLOUDS):
        cloud, scene = KINDS[i % len(KINDS)](rng), scene_of(rng)
        planner = others[i // 10 % len(others)] if i % 10 == 0 else default
        outcomes[outcome_of(lambda: planner.plan(cloud, **scene))] += 1  # noqa: B023
    assert sum(outcomes.values()) == CLOUDS
    assert min(outcomes[name] for name in ("plan", "reason", "CloudError", "ConfigError")) > CLOUDS // 50
