"""The compiled kernels against their references: samples and groups to the last bit, on clouds full of ties as well."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pec.errors import CloudError
from pec.preprocessing import compiled as kernels
from pec.preprocessing.isolated import isolation, reference
from pec.preprocessing.ordering import anchor_positions, group_order
from pec.preprocessing.preprocess import Preprocess, farthest_points

needs_kernels = pytest.mark.skipif(not kernels.AVAILABLE, reason="this installation has no compiled kernels")

CANONICAL = Preprocess(n_candidates=128, start="farthest", pose="principal", ordering="anchors")
UPRIGHT = Preprocess(n_candidates=1024, sampling="random", pose="upright", ordering="anchors", anchor_unit="cloud")
MIRRORS = [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1)]


@st.composite
def clouds(draw: st.DrawFn, least: int = 64, most: int = 700) -> np.ndarray:
    """Any cloud (N, 3): smooth or on a grid, where most distances are ties; either precision, near or far."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.integers(least, most))
    step = draw(st.sampled_from([0.0, 0.25, 0.1]))
    points = rng.normal(size=(n, 3)) * rng.uniform(0.1, 1, 3) if step == 0 else rng.integers(-4, 5, (n, 3)) * step
    points = (points + draw(st.sampled_from([0.0, 0.3, 50.0]))) * draw(st.sampled_from([1.0, 1e-3, 1e-12, 1e6]))
    return points.astype(draw(st.sampled_from([np.float32, np.float64])))


@needs_kernels
@settings(max_examples=150, deadline=None)
@given(clouds(), st.sampled_from([2, 64, 128]), st.booleans(), st.booleans())
def test_sample_is_the_reference_s_to_the_last_bit(
    cloud: np.ndarray, n: int, from_centroid: bool, turned: bool
) -> None:
    cloud = np.asfortranarray(cloud) if turned else cloud
    n = min(n, len(cloud))
    start = None if from_centroid else len(cloud) // 3
    np.testing.assert_array_equal(kernels.farthest_points(cloud, n, start), farthest_points(cloud, n, start))


@needs_kernels
@settings(max_examples=100, deadline=None)
@given(clouds(most=64), st.sampled_from([1, 2, 4, 8, 16, 32, 64]))
def test_groups_are_the_reference_s_also_where_points_are_equally_near(cloud: np.ndarray, group_size: int) -> None:
    cloud = cloud.astype(np.float32)
    cloud -= cloud.mean(axis=0)
    expected = group_order(torch.from_numpy(cloud)[None], group_size)[0]
    np.testing.assert_array_equal(kernels.group_order(cloud, group_size), expected)


@needs_kernels
@settings(max_examples=100, deadline=None)
@given(clouds(least=5), st.floats(0, 1000))
def test_isolations_are_the_reference_s_but_for_rounding(cloud: np.ndarray, away: float) -> None:
    cloud = np.concatenate([cloud, cloud[:1] * (1 + away)])  # a stray, too, perhaps so far that the grid is coarse
    np.testing.assert_allclose(isolation(cloud), reference(cloud), rtol=1e-6, atol=0)
    assert not isolation(np.repeat(cloud[:1], 20, axis=0)).any()


@needs_kernels
@settings(max_examples=60, deadline=None)
@given(clouds(), st.sampled_from(["axis", "cloud"]))
def test_each_position_takes_a_point_than_which_none_is_nearer_but_for_rounding(cloud: np.ndarray, unit: str) -> None:
    preprocess = replace(UPRIGHT, anchor_unit=unit)
    sample = preprocess.sample(cloud, np.random.default_rng(0))
    points = sample.astype(float)
    variance = (points**2).mean(axis=0)
    spread = np.maximum(np.sqrt(variance if unit == "axis" else variance.sum()), 1e-9)
    anchors = anchor_positions(64).double().numpy()
    for view, signs in zip(preprocess.views([sample])[0], MIRRORS, strict=True):
        rows = set(map(tuple, (sample * np.float32(signs)).tolist()))
        assert all(tuple(point) in rows for point in view.tolist())
        taken = np.linalg.norm(view / spread - anchors, axis=1)
        least = np.linalg.norm((points * signs / spread)[:, None] - anchors, axis=2).min(axis=0)
        np.testing.assert_allclose(taken, least, rtol=1e-5, atol=1e-5)


@needs_kernels
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(64, 300))
def test_principal_views_are_those_of_the_reference_but_for_near_ties(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    # Axes that rounding cannot turn.
    cloud = rng.normal(size=(n, 3)) * [0.1, 0.05, 0.02] @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    sample = CANONICAL.sample(cloud, rng)
    copies, valid = torch.from_numpy(sample).expand(4, -1, -1), torch.ones(4, len(sample), dtype=torch.bool)
    left = list(CANONICAL.arrange(copies, valid, torch.arange(4)).numpy())
    for view in CANONICAL.views([sample])[0]:  # in any order
        apart = [int((np.abs(view - other).max(axis=1) > 1e-6).sum()) for other in left]
        assert min(apart) <= 1
        left.pop(int(np.argmin(apart)))


@needs_kernels
def test_position_between_equally_near_points_takes_the_first() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    signs = np.ones((1, 3), np.float32)
    anchors = np.array([[0, 0, 0], [2, 0, 0], [-2, -2, 2]], np.float32)
    found = kernels.arranged(corners, anchors, signs, principal=False, each_axis=True)[0]
    assert found.tolist() == [[-1, -1, -1], [1, -1, -1], [-1, -1, 1]]


@needs_kernels
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_cloud_that_is_not_ordinary_is_left_to_the_reference(value: float) -> None:
    cloud = np.random.default_rng(0).normal(size=(100, 3))
    cloud[7, 1] = value
    assert kernels.farthest_points(cloud, 64, 0) is None
    if not np.isfinite(value):
        with pytest.raises(CloudError, match="1 of 100 points are not finite"):
            Preprocess().sample(cloud, np.random.default_rng(0))


@needs_kernels
def test_arrays_of_another_type_or_size_are_refused() -> None:
    from pec.preprocessing import _kernels

    cloud = np.zeros((100, 3), np.float32)
    with pytest.raises(TypeError, match="points: items of another type"):
        _kernels.sample(cloud.astype(np.float16), 0, cloud[:64])
    with pytest.raises(ValueError, match="the cloud has fewer points"):
        _kernels.sample(cloud[:50], 0, np.empty((64, 3), np.float32))
    with pytest.raises(ValueError, match="does not fit the points"):
        _kernels.group(cloud, 7, np.empty(100, np.int64))
    with pytest.raises(ValueError, match="for each sign and anchor"):
        _kernels.arrange(cloud, cloud[:64], cloud[:4], True, True, np.empty((4, 63, 3), np.float32))
    with pytest.raises(ValueError, match="one for each point"):
        _kernels.isolation(cloud.astype(float), np.empty(99))
    locked = np.empty((64, 3), np.float32)
    locked.flags.writeable = False
    with pytest.raises(ValueError, match="read-only"):
        _kernels.sample(cloud, 0, locked)


_WITHOUT = """
import sys
sys.modules["pec.preprocessing._kernels"] = None  # as where it was not compiled
import numpy as np
import torch
from pec import PEC, Classifier
from pec.preprocessing import compiled as kernels
from pec.checkpoint import Checkpoint
from pec.preprocessing.preprocess import Preprocess
assert not kernels.AVAILABLE
torch.manual_seed(0)
cloud = np.random.default_rng(0).exponential(size=(500, 3)) * [0.1, 0.05, 0.02]
ours = {"n_candidates": 128, "start": "farthest", "pose": "principal", "ordering": "anchors"}
for settings in ({}, ours, ours | {"drop_isolated": 1.5}):
    classifier = Classifier(Checkpoint(PEC(64, 3), ["a", "b", "c"], Preprocess(**settings), 0.01, 0))
    for prediction in classifier.predict([cloud, cloud[:70], cloud[100:]]):  # of 70 points there are fewer candidates
        print(*prediction.probabilities.values())
"""


@pytest.mark.slow
@needs_kernels
def test_without_a_compiler_the_answers_are_the_same() -> None:
    answers = []
    for source in (
        _WITHOUT,
        _WITHOUT.replace('sys.modules["pec.preprocessing._kernels"] = None', "").replace("assert not", "assert"),
    ):
        child = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=True, timeout=120)
        answers.append([[float(value) for value in line.split()] for line in child.stdout.splitlines()])
    np.testing.assert_allclose(*answers, rtol=0, atol=1e-4)
