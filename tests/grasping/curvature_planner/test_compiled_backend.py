"""The compiled kernels against their NumPy reference: the same plan to the last bit, on clouds full of ties as well."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, box_top, grid, moved, pliers, roof, standing_can, whole_cylinder
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

import grasping
from grasping import CloudError, ConfigError, CurvaturePlanner, GraspPlan

needs_kernels = pytest.mark.skipif(not grasping.compiled, reason="this installation has no compiled kernels")

BAR = grid((-0.1, 0.1), (-0.012, 0.012), step=0.004)  # hangs over the object, between the fingers
NEIGHBOURS = np.vstack([moved(box_top(0.05, 0.03, 0.08), y=0.05), np.column_stack([BAR, np.full(len(BAR), 0.14)])])
ROOF = roof(0.25)
HOLES = np.column_stack([grid((-0.3, -0.1), (-0.05, 0.01), step=0.004), np.zeros(51 * 16)])
SCENES: list[dict[str, Any]] = [
    {"up": UP, "table": TABLE},
    {"up": UP},
    {},
    {"up": UP, "table": TABLE, "obstacles": NEIGHBOURS},
    {"up": UP, "table": TABLE, "obstacles": ROOF},  # under which hands are tilted
    {"up": UP, "table": TABLE, "obstacles": NEIGHBOURS, "viewpoint": [0.5, 0.1, 0.25], "unseen": HOLES},
    {"viewpoint": [[0.5, 0.1, 0.25], [0.2, -0.4, 0.3]], "unseen": HOLES},
]


def assert_identical(one: GraspPlan, other: GraspPlan) -> None:
    assert one.reason == other.reason
    assert len(one.candidates) == len(other.candidates)
    for a, b in zip(one.candidates, other.candidates, strict=True):
        np.testing.assert_array_equal(a.pose, b.pose)
        assert (a.width, a.score, a.kind, a.region, a.terms) == (b.width, b.score, b.kind, b.region, b.terms)
    assert len(one.regions) == len(other.regions)
    for p, q in zip(one.regions, other.regions, strict=True):
        np.testing.assert_array_equal(p.points, q.points)
        assert (p.primitive, p.width, p.curvature, p.verdict) == (q.primitive, q.width, q.curvature, q.verdict)
        assert (p.slab, p.cluster) == (q.slab, q.cluster)


def assert_agreement(cloud: np.ndarray, scene: dict[str, Any], **options: Any) -> None:
    outcomes: list[GraspPlan | str] = []
    for compiled in (True, False):
        try:
            outcomes.append(CurvaturePlanner(compiled=compiled, **options).plan(cloud, **scene))
        except (CloudError, ConfigError) as error:
            outcomes.append(str(error))
    if isinstance(outcomes[0], str) or isinstance(outcomes[1], str):
        assert outcomes[0] == outcomes[1]
    else:
        assert_identical(outcomes[0], outcomes[1])


SHAPES = {
    "box": box_top(0.15, 0.05, 0.06),
    "square box": box_top(0.06, 0.06, 0.06),
    "box too wide": box_top(0.2, 0.2, 0.05),
    "flat box": box_top(0.1, 0.05, 0.005),
    "large box": box_top(1.5, 1.2, 0.3, step=0.02),
    "can": standing_can(0.033, 0.1),
    "pliers": pliers(),
    "cylinder": whole_cylinder(0.03, 0.1),
}


@needs_kernels
@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize(
    "scene", SCENES, ids=["table", "up", "nothing known", "neighbours", "roof", "viewpoint", "two viewpoints"]
)
def test_plans_of_shapes_full_of_ties_are_identical(name: str, scene: dict[str, Any]) -> None:
    assert_agreement(SHAPES[name], scene)


@needs_kernels
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(SCENES), st.sampled_from([0.0, 0.001]), st.sampled_from([300, 4000]))
def test_plans_of_turned_and_noisy_heaps_of_boxes_are_identical(
    seed: int, scene: dict[str, Any], noise: float, n_points: int
) -> None:
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(3):
        turn = Rotation.from_euler("z", rng.uniform(0, np.pi)).as_matrix()
        part = box_top(*rng.uniform(0.02, 0.11, 2), rng.uniform(0.015, 0.08), step=0.005)
        parts.append(part @ turn.T + [*rng.uniform(-0.03, 0.03, 2), 0.0])
    cloud = np.vstack(parts)
    cloud += rng.normal(scale=noise, size=cloud.shape) if noise else 0.0
    assert_agreement(cloud, scene, n_points=n_points)


@needs_kernels
@settings(max_examples=40, deadline=None)
@given(
    arrays(np.int8, st.tuples(st.integers(10, 80), st.just(3)), elements=st.integers(0, 12)),
    st.sampled_from([0.001, 0.003, 0.009]),
    st.sampled_from(SCENES),
)
def test_plans_of_points_on_a_lattice_are_identical(lattice: np.ndarray, step: float, scene: dict[str, Any]) -> None:
    assert_agreement(lattice * step, scene)


@needs_kernels
@settings(max_examples=60, deadline=None)
@given(
    arrays(
        np.float32,
        st.tuples(st.integers(0, 60), st.just(3)),
        elements=st.floats(-2, 2, width=32)
        | st.sampled_from([0.0, 0.01, 1e-30, 1e9, np.float32(np.nan), np.float32(np.inf)]),
    ),
    st.sampled_from(SCENES),
)
def test_any_numbers_end_alike(cloud: np.ndarray, scene: dict[str, Any]) -> None:
    assert_agreement(cloud, scene)


@needs_kernels
@pytest.mark.parametrize(
    "scene", SCENES, ids=["table", "up", "nothing known", "neighbours", "roof", "viewpoint", "two viewpoints"]
)
def test_the_sign_of_zero_makes_no_difference(scene: dict[str, Any]) -> None:
    """A sum of negative zeros is 0 where it begins with 0, and −0 where it begins with the first of them."""
    cloud = np.full((10, 3), -0.0)
    cloud[0, 0] = 0.01
    assert_agreement(cloud, scene)


@needs_kernels
def test_threads_do_not_disturb_each_other() -> None:
    planner = CurvaturePlanner(compiled=True)
    clouds = [SHAPES[name] for name in ("box", "can", "pliers", "cylinder")] * 4
    alone = [planner.plan(cloud, up=UP, table=TABLE) for cloud in clouds]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda cloud: planner.plan(cloud, up=UP, table=TABLE), clouds))
    for one, other in zip(alone, together, strict=True):
        assert_identical(one, other)


@needs_kernels
def test_the_kernels_refuse_arrays_that_they_cannot_read() -> None:
    from grasping.curvature_planner import _kernels

    cloud, axes, out = np.zeros((3, 20)), np.eye(3), np.zeros((3, 20))
    assert len(_kernels.place(cloud, axes, 0.0, 0.004, out)) == 7
    for wrong in (cloud.astype(np.float32), cloud.astype(np.int64), np.zeros((3, 20), ">f8")):
        with pytest.raises(TypeError, match="cloud: items of another type"):
            _kernels.place(wrong, axes, 0.0, 0.004, out)
    for wrong in (np.zeros((20, 3)), np.zeros(60), np.zeros((3, 0))):
        with pytest.raises(ValueError, match="cloud"):
            _kernels.place(wrong, axes, 0.0, 0.004, out)
    with pytest.raises(ValueError, match="contiguous"):
        _kernels.place(np.zeros((20, 3)).T, axes, 0.0, 0.004, out)
    with pytest.raises(ValueError, match="local"):
        _kernels.place(cloud, axes, 0.0, 0.004, np.zeros((3, 19)))
    out.flags.writeable = False
    with pytest.raises((ValueError, BufferError), match=r"read-only|not writable"):
        _kernels.place(cloud, axes, 0.0, 0.004, out)


@needs_kernels
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_the_kernels_survive_numbers_that_the_planner_keeps_from_them(value: float) -> None:
    from grasping.curvature_planner import _kernels

    cloud = np.random.default_rng(0).uniform(0, 0.1, (3, 50))
    cloud[:, 7] = value
    rows, parts = cloud.T.copy(), (np.empty((50, 7), np.int64), np.empty((50, 5)))
    calls = (
        lambda: _kernels.short_side(cloud, np.eye(3), 0.004),
        lambda: _kernels.thin(cloud, np.eye(3), 0.0025, 4.0, np.empty((3, 50))),
        lambda: _kernels.neighbours(rows, np.eye(3), *(0.0,) * 3, value, 0.2, 0.003, np.empty((3, 50))),
        lambda: _kernels.look(cloud, rows, rows, 0.0, 0.0, 1.0, np.empty(15), np.empty((96, 96))),
        lambda: _kernels.place(cloud, np.eye(3), np.nan, 0.004, np.empty((3, 50))),
        lambda: _kernels.survey(cloud, np.empty(0), np.empty(0), 0.03, 0.01, np.empty(50, np.int64), *parts),
        lambda: _kernels.scan(
            cloud,
            cloud,
            *(np.array([0.0]),) * 4,
            *(0.03, 0.04, 0.13, 0.1, value, value),
            *(8, 13),
            np.empty((9, 160)),
        ),
    )
    for call in calls:
        with suppress(ValueError):  # "the cloud is too large"
            call()


WITHOUT_KERNELS = """
import sys
sys.modules["grasping.curvature_planner._kernels"] = None  # as where no compiler was found
import numpy as np, grasping
assert not grasping.compiled
cloud = np.random.default_rng(0).uniform([-0.06, -0.02, 0], [0.06, 0.02, 0.05], (500, 3))
print(grasping.CurvaturePlanner().plan(cloud, up=(0, 0, 1), table=(0, 0, 1, 0)).best.pose.tolist())
try:
    grasping.CurvaturePlanner(compiled=True)
except grasping.ConfigError as error:
    print(error)
"""


def test_without_kernels_the_planner_plans_the_same_and_says_so() -> None:
    child = subprocess.run([sys.executable, "-c", WITHOUT_KERNELS], capture_output=True, text=True, check=True)
    pose, refusal = child.stdout.splitlines()
    cloud = np.random.default_rng(0).uniform([-0.06, -0.02, 0], [0.06, 0.02, 0.05], (500, 3))
    best = CurvaturePlanner().plan(cloud, up=UP, table=TABLE).best
    assert best is not None
    assert pose == str(best.pose.tolist())
    assert "no compiled kernels" in refusal


def test_the_default_planner_does_without_scipy_which_is_slow_to_import() -> None:
    script = (
        "import sys, grasping; assert 'scipy' not in sys.modules; grasping.Segmenter; assert 'scipy' in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
