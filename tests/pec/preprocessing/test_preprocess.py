"""Sampling and ordering: known answers, agreement with plain references, and errors that say what is wrong."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pec.errors import CloudError, ConfigError
from pec.preprocessing.isolated import without_isolated
from pec.preprocessing.ordering import anchor_positions, group_order, nearest_candidates
from pec.preprocessing.pose import principal_pose
from pec.preprocessing.preprocess import Preprocess, farthest_point_sampling

CANONICAL = Preprocess(n_candidates=128, start="farthest", pose="principal", ordering="anchors")


def _plain_fps(points: np.ndarray, n: int, start: int) -> list[int]:
    chosen = [start]
    while len(chosen) < n:
        distances = ((points[:, None] - points[chosen][None]) ** 2).sum(axis=2).min(axis=1)
        chosen.append(int(distances.argmax()))
    return chosen


def _plain_groups(points: np.ndarray, k: int) -> list[int]:
    remaining, groups = list(range(len(points))), []
    while remaining:
        seed = points[remaining[0]]
        group = sorted(remaining, key=lambda i: ((points[i] - seed) ** 2).sum())[:k]
        remaining = [i for i in remaining if i not in group]
        groups.append(group)
    groups.sort(key=lambda group: np.linalg.norm(points[group].mean(axis=0)))
    return [i for group in groups for i in group]


def _lopsided(rng: np.random.Generator, n: int = 300) -> np.ndarray:
    """A cloud whose axes and signs are beyond doubt."""
    return (rng.exponential(size=(n, 3)) * [0.1, 0.05, 0.02]).astype(np.float32)


def test_fps_on_a_line_takes_the_ends_then_the_middle():
    line = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1)
    assert farthest_point_sampling(line, 4, 0).tolist() == [0, 4, 2, 1]


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(8, 200))
def test_fps_agrees_with_the_plain_one(seed, size):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(size, 3)).astype(np.float32)
    start = int(rng.integers(size))
    assert farthest_point_sampling(points, 8, start).tolist() == _plain_fps(points, 8, start)


def test_grouping_of_two_clumps_puts_the_nearer_first():
    # First point belongs to the far clump; inside a group the nearest to the seed comes first.
    points = torch.tensor([[[4.0, 0, 0], [-1.0, 0, 0], [4.5, 0, 0], [-1.2, 0, 0]]])
    assert group_order(points, 2).tolist() == [[1, 3, 0, 2]]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([4, 8, 16, 32, 64]))
def test_grouping_agrees_with_the_plain_one(seed, k):
    points = np.random.default_rng(seed).normal(size=(3, 64, 3))
    order = group_order(torch.from_numpy(points), k)
    assert order.tolist() == [_plain_groups(cloud, k) for cloud in points]


@pytest.mark.parametrize("k", [4, 8, 16, 32, 64])
def test_published_input_is_a_permutation_of_the_sample(k):
    preprocess = Preprocess(group_size=k)
    sample = preprocess.sample(_lopsided(np.random.default_rng(0)), np.random.default_rng(1))
    ordered = preprocess.arrange(torch.from_numpy(sample)[None], torch.ones(1, 64, dtype=torch.bool))[0]
    assert sorted(map(tuple, ordered.tolist())) == sorted(map(tuple, sample.tolist()))


def test_sample_is_centred_on_the_whole_cloud_and_keeps_its_size():
    cloud = _lopsided(np.random.default_rng(0)) + np.float32(2)
    sample = Preprocess().sample(cloud, np.random.default_rng(1)).astype(np.float64) + cloud.mean(axis=0, dtype=float)
    assert len(sample) == 64
    for point in sample:
        assert np.abs(cloud - point).max(axis=1).min() < 1e-6


def test_small_cloud_gives_all_its_points():
    cloud = _lopsided(np.random.default_rng(0), 70)
    assert CANONICAL.sample(cloud, np.random.default_rng(0)).shape == (70, 3)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_canonical_input_does_not_depend_on_pose_or_order(seed):
    rng = np.random.default_rng(seed)
    cloud = _lopsided(rng).astype(np.float64)
    moved = rng.permutation(cloud) @ Rotation.random(random_state=seed).as_matrix().T + rng.uniform(-1, 1, 3)
    inputs = []
    for points in (cloud, moved):
        sample = torch.from_numpy(CANONICAL.sample(points, rng))[None]
        inputs.append(CANONICAL.arrange(sample, torch.ones(sample.shape[:2], dtype=torch.bool)))
    # Float32 rounding may tip a near tie between two candidates for one position, not more.
    assert ((inputs[0] - inputs[1]).abs().amax(dim=2) > 1e-4).sum() <= 2


def test_principal_pose_is_a_rotation_with_heavier_tails_ahead():
    points = torch.from_numpy(_lopsided(np.random.default_rng(3)))[None]
    valid = torch.ones(points.shape[:2], dtype=torch.bool)
    posed = principal_pose(points, valid)
    centred = points - points.mean(dim=1, keepdim=True)
    rotation = torch.linalg.lstsq(centred[0], posed[0]).solution
    assert torch.allclose(rotation @ rotation.T, torch.eye(3), atol=1e-5)
    assert torch.linalg.det(rotation).item() == pytest.approx(1, abs=1e-5)
    assert (posed[0, :, :2].pow(3).sum(dim=0) > 0).all()
    assert posed[0].var(dim=0).diff().max() < 0


def test_principal_pose_ignores_what_is_not_valid():
    points = torch.from_numpy(_lopsided(np.random.default_rng(3)))[None]
    valid = torch.ones(points.shape[:2], dtype=torch.bool)
    valid[:, 100:] = False
    spoiled = torch.where(valid[..., None], points, 7.0)
    assert torch.allclose(principal_pose(spoiled, valid)[:, :100], principal_pose(points[:, :100], valid[:, :100]))


def test_views_are_the_four_half_turns():
    points = torch.from_numpy(_lopsided(np.random.default_rng(3)))[None].expand(4, -1, -1)
    valid = torch.ones(points.shape[:2], dtype=torch.bool)
    posed = principal_pose(points, valid, torch.arange(4))
    signs = (posed / posed[:1]).mean(dim=1).round().int().tolist()
    assert signs == [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]


def test_anchors_take_the_nearest_valid_candidate():
    anchors = anchor_positions(64)
    assert anchors.shape == (64, 3)
    # Candidates on the anchors themselves, with unit spread along each axis, so that each takes its own.
    candidates = (anchors / anchors.square().mean(dim=0).sqrt())[None]
    valid = torch.ones(1, 64, dtype=torch.bool)
    assert nearest_candidates(candidates, valid, candidates[0]).tolist() == [list(range(64))]
    valid[0, 5] = False
    assert nearest_candidates(candidates, valid, candidates[0])[0, 5] != 5


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_nearest_candidates_agree_with_the_plain_ones(seed, each_axis):
    cloud = np.random.default_rng(seed).normal(size=(30, 3)) * [3, 1, 0.2]
    unit = np.sqrt((cloud**2).mean(axis=0)) if each_axis else np.sqrt((cloud**2).sum(axis=1).mean())
    anchors = anchor_positions(64).double()
    expected = [int(((cloud / unit - anchor) ** 2).sum(axis=1).argmin()) for anchor in anchors.numpy()]
    valid = torch.ones(1, 30, dtype=torch.bool)
    assert nearest_candidates(torch.from_numpy(cloud)[None], valid, anchors, each_axis=each_axis).tolist() == [expected]


@pytest.mark.parametrize(
    ("cloud", "message"),
    [
        (np.zeros((10, 3)), "takes 64 points, the cloud has only 10"),
        (np.zeros((100, 2)), r"shape \(N, 3\), got \(100, 2\)"),
        (np.full((100, 3), np.nan), "100 of 100 points are not finite"),
        (np.zeros((100, 3), int), "floats"),
    ],
)
def test_bad_cloud_is_an_error_that_says_why(cloud, message):
    with pytest.raises(CloudError, match=message):
        Preprocess().sample(cloud, np.random.default_rng(0))


@pytest.mark.parametrize(
    "settings",
    [
        {"group_size": 5},
        {"ordering": "alphabetical"},
        {"pose": "upside down"},
        {"start": "first"},
        {"n_candidates": 32},
        {"n_candidates": 128},
        {"n_points": 63},
        {"anchor_unit": "metre"},
        {"sampling": "nearest"},
        {"drop_isolated": 0.5},
    ],
)
def test_senseless_settings_are_an_error(settings):
    with pytest.raises(ConfigError, match=next(iter(settings))):
        Preprocess(**settings)


def _plate(n=20):
    """A grid of n × n points, 0.01 m apart."""
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    return 0.01 * np.stack([x, y, 0 * x], axis=2).reshape(-1, 3).astype(float)


def test_only_points_that_stand_alone_are_dropped_in_any_unit():
    plate = _plate()
    strays = np.array([[0.1, 0.1, 0.1], [0.1, 0.1, 0.12], [-0.3, 0.0, 0.0], [0.0, 0.0, 5.0]])  # two of them are a pair
    cloud = np.concatenate([plate[:200], strays, plate[200:]])
    for unit in (1.0, 1000.0):
        left = without_isolated(unit * cloud, 2.1, least=64)  # a corner's fourth neighbour is two steps away
        assert np.array_equal(left, unit * plate)


def test_as_many_points_stay_as_the_network_takes_the_least_isolated():
    cloud = np.concatenate([_plate(9), [[0.5, 0.5, 0.1 * (1 + i)] for i in range(4)]])
    left = without_isolated(cloud, 1.0, least=83)
    assert len(left) == 83
    assert np.array_equal(left[:81], cloud[:81])
    assert len(without_isolated(cloud, 1.0, least=2)) < 81


@pytest.mark.parametrize("cloud", [np.eye(3), np.repeat(np.eye(3), 30, axis=0)])
def test_of_few_points_and_of_points_that_come_many_times_all_stay(cloud):
    assert without_isolated(cloud, 1.5, least=2) is cloud


def test_strays_change_nothing_where_they_are_dropped():
    plate = _plate()
    cloud = np.concatenate([plate, [[0.1, 0.1, 0.4], [0.1, -0.3, 0.1]]])
    for chosen in ({"start": "farthest"}, {"n_candidates": 512, "sampling": "random", "ordering": "anchors"}):
        kept, dropped = Preprocess(**chosen), Preprocess(drop_isolated=2.1, **chosen)
        clean, seen = (p.sample(c, np.random.default_rng(0)) for p, c in ((kept, plate), (dropped, cloud)))
        assert np.array_equal(clean, seen)
        assert not np.array_equal(kept.sample(cloud, np.random.default_rng(0)), clean)
    with pytest.raises(CloudError, match="1 of 401 points are not finite"):
        dropped.sample(np.concatenate([plate, [[np.nan, 0, 0]]]), np.random.default_rng(0))


def test_random_sampling_takes_all_points_or_some_of_them_once():
    cloud = _lopsided(np.random.default_rng(0), 300)
    centred = (cloud - cloud.mean(axis=0, dtype=float)).astype(np.float32)
    sampled = [
        Preprocess(n_candidates=n, sampling="random", ordering="anchors").sample(cloud, np.random.default_rng(0))
        for n in (400, 100)
    ]
    assert np.array_equal(sampled[0], centred)
    rows = set(map(tuple, sampled[1].tolist()))
    assert len(rows) == 100
    assert rows < set(map(tuple, centred.tolist()))


def test_views_of_an_upright_cloud_are_its_mirror_images():
    preprocess = Preprocess(n_candidates=300, sampling="random", pose="upright", ordering="anchors")
    points = torch.from_numpy(_lopsided(np.random.default_rng(3)))[None]
    valid = torch.ones(points.shape[:2], dtype=torch.bool)
    for view, signs in enumerate([(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1)]):
        mirrored = points * torch.tensor(signs)
        assert preprocess.arrange(points, valid, torch.tensor([view])).equal(preprocess.arrange(mirrored, valid))


@pytest.mark.parametrize("preprocess", [Preprocess(size="unit"), replace(CANONICAL, size="unit")])
def test_of_unit_size_a_cloud_is_the_same_at_every_scale_and_by_either_path(preprocess):
    cloud = _lopsided(np.random.default_rng(0))
    inputs = []
    for scale in (1, 50):
        sample = preprocess.sample(scale * cloud, np.random.default_rng(1))
        inputs.append(preprocess.arrange(torch.from_numpy(sample)[None], torch.ones(1, len(sample), dtype=torch.bool)))
        views = preprocess.views([sample])[0]
        assert np.abs(views - inputs[0].numpy()).max(axis=(1, 2)).min() < 1e-4
    assert torch.allclose(*inputs, atol=1e-4)
    spread = np.sqrt((sample**2).sum(axis=1).mean())
    kept = replace(preprocess, size="kept").views([sample])[0]
    assert np.allclose(kept, spread * views, atol=1e-3 * spread)


def test_unit_size_is_measured_on_what_is_valid():
    points = torch.tensor([[[2.0, 0, 0], [-2.0, 0, 0], [9.0, 9, 9]]])
    valid = torch.tensor([[True, True, False]])
    unit = Preprocess(n_points=2, n_candidates=3, pose="given", ordering="anchors", size="unit")
    assert set(unit.arrange(points, valid)[0, :, 0].tolist()) <= {1.0, -1.0}
    with pytest.raises(ConfigError, match=r"preprocess\.size must be one of \('kept', 'unit', 'root'\), got 'big'"):
        Preprocess(size="big")


@pytest.mark.parametrize(
    ("spread", "rooted"), [(0.04, 0.2), (0.36, 0.6), (1.0, 1.0), (500.0, 2**0.5), (1e-4, 0.02**0.5)]
)
@pytest.mark.parametrize("ordering", ["groups", "anchors"])
def test_at_root_size_a_cloud_of_any_unit_comes_with_the_root_of_its_spread(spread, rooted, ordering):
    preprocess = Preprocess(ordering=ordering, size="root")
    cloud = np.random.default_rng(0).normal(size=(64, 3)).astype(np.float32)
    cloud -= cloud.mean(axis=0)
    cloud *= np.float32(spread / np.sqrt((cloud**2).sum(axis=1).mean()))
    unit = replace(preprocess, size="unit")
    for way in (lambda p: p.views([cloud])[0, 0], lambda p: _arranged(p, cloud)):
        assert np.allclose(way(preprocess), rooted * way(unit), atol=1e-5)


def _arranged(preprocess, cloud):
    return preprocess.arrange(torch.from_numpy(cloud)[None], torch.ones(1, len(cloud), dtype=torch.bool))[0].numpy()
