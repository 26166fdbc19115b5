from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seen_stones import cut_out, model_of, off, pose

from grasping.pose import kernels
from grasping.pose.alignment import align, partners
from grasping.pose.point_pairs import CELLS, FINE, TURNS, PairTable, pairs_of
from grasping.pose.prepared_model import PreparedModel
from grasping.pose.scene_surface import normals_at, seen_surface, thinner
from grasping.pose.sight_check import CLEAR, HIDDEN, SEEN, UNKNOWN, look
from grasping.pose.view import View
from grasping.pose.voting import vote

compiled = kernels.compiled
needs_kernels = pytest.mark.skipif(compiled is None, reason="this installation has no compiled kernels")
EYE = np.zeros(3)


def near(T: np.ndarray, count: int, turn: float = 0.1, shift: float = 0.008) -> np.ndarray:
    """(count, 4, 4) poses about T."""
    rng = np.random.default_rng(0)
    poses = np.repeat(T[None], count, axis=0)
    poses[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, turn, (count, 3))).as_matrix() @ T[:3, :3]
    poses[:, :3, 3] += rng.normal(0, shift, (count, 3))
    return poses


def cases() -> dict[str, Callable[[], np.ndarray]]:
    """A call of each kernel through what it speeds up."""
    prepared, T = PreparedModel(model_of("stone")), pose(1)
    model, cloud = prepared.model, cut_out("stone", pose(1))
    points, normals = seen_surface(cloud, EYE, 0.008)
    sample = thinner(points, normals, prepared.sampled)
    pairs = pairs_of(*sample, np.arange(len(sample[0])), prepared.table.step, model.diameter)
    lattice = np.stack(np.meshgrid(*[np.arange(12) * 0.0025] * 3), axis=-1).reshape(-1, 3)
    view, poses = View.of(cloud, EYE), np.concatenate([near(T, 5), near(T, 2, 2.0, 0.3)])
    return {
        "vote": lambda: vote(prepared.table, pairs, len(sample[0]), 3),
        "align": lambda: align(prepared.grid, points, normals, poses, np.array([0.03, 0.02, 0.01])),
        "align until it rests": lambda: align(prepared.grid, points, normals, poses, np.full(40, 0.02)),
        "partners": lambda: partners(prepared.grid, points, normals, poses)[0],
        "places": lambda: partners(prepared.grid, points, normals, poses)[1],
        "normals": lambda: normals_at(points, cloud, 12),
        "normals of a lattice": lambda: normals_at(lattice[::5], lattice, 12),  # many neighbours are equally near
        "look": lambda: look(view, model.points, model.normals, prepared.spacing, model.diameter, poses, 0.003),
    }


@needs_kernels
def test_the_kernels_do_as_numpy_does_to_the_last_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, call in cases().items():
        monkeypatch.setattr(kernels, "compiled", compiled)
        fast = call()
        monkeypatch.setattr(kernels, "compiled", None)
        np.testing.assert_array_equal(fast, call(), err_msg=name)
        assert fast.any(), name


def test_alignment_brings_a_pose_that_is_off_home() -> None:
    prepared, T = PreparedModel(model_of("stone")), pose(2)
    points, normals = seen_surface(cut_out("stone", T), EYE, 0.005)
    start = near(T, 4, 0.08, 0.006)
    for before, after in zip(start, align(prepared.grid, points, normals, start, np.full(60, 0.02)), strict=True):
        assert off(prepared.model, after, T) < min(0.0015, off(prepared.model, before, T))
        np.testing.assert_allclose(after[:3, :3] @ after[:3, :3].T, np.eye(3), atol=1e-9)


def test_a_pose_at_rest_stays_whatever_steps_are_left() -> None:
    prepared, T = PreparedModel(model_of("stone")), pose(2)
    points, normals = seen_surface(cut_out("stone", T), EYE, 0.005)
    start = near(T, 4, 0.08, 0.006)
    some, many = (align(prepared.grid, points, normals, start, np.full(count, 0.02)) for count in (200, 400))
    np.testing.assert_array_equal(some, many)


def test_a_model_is_seen_where_it_is_and_stands_before_hides_behind_or_lies_beside_elsewhere() -> None:
    prepared, T = PreparedModel(model_of("can")), pose(6)
    model = prepared.model
    view = View.of(cut_out("can", T), EYE)
    poses = np.repeat(T[None], 4, axis=0)
    poses[1, 2, 3] -= 0.05
    poses[2, 2, 3] += 0.2
    poses[3, 0, 3] += 0.4
    sums = look(view, model.points, model.normals, prepared.spacing, model.diameter, poses, 0.003)
    assert sums.argmax(axis=1).tolist() == [SEEN, CLEAR, HIDDEN, UNKNOWN]
    assert (sums.max(axis=1) > 0.6 * sums.sum(axis=1)).all()
    assert sums[0, SEEN] > 0.95 * sums[0].sum()


def test_normals_of_a_ball_point_to_the_eye_and_away_from_its_middle() -> None:
    directions = np.random.default_rng(0).normal(size=(20000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    middle = np.array([0.1, 0.0, 0.5])
    seen = middle + 0.05 * directions[directions @ middle < -0.1]
    points, normals = seen_surface(seen, EYE, 0.005)
    outward = (points - middle) / np.linalg.norm(points - middle, axis=1)[:, None]
    assert np.median(np.einsum("ij,ij->i", normals, outward)) > 0.995
    assert (np.einsum("ij,ij->i", normals, points) < 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


@needs_kernels
def test_points_in_no_order_are_refused() -> None:
    unordered = np.array([[1.0, 0, 0], [np.nan, 0, 0], [0, 0, 0]])
    with pytest.raises(ValueError, match="out of the array"):
        compiled.normals(unordered, np.zeros((1, 3)), 0, 3, np.zeros((1, 3)))


def test_pairs_keep_their_bins_when_the_points_are_moved() -> None:
    points, normals = thinner(model_of("stone").points, model_of("stone").normals, 0.02)
    T = pose(3, (4.0, -2.0, 1.0))
    here = pairs_of(points, normals, np.arange(len(points)), 0.01, 0.1)
    there = pairs_of(points @ T[:3, :3].T + T[:3, 3], normals @ T[:3, :3].T, np.arange(len(points)), 0.01, 0.1)
    np.testing.assert_array_equal(here.second, there.second)
    np.testing.assert_allclose(here.bins, there.bins, atol=1e-5)


def test_a_table_has_every_pair_once() -> None:
    points, normals = thinner(model_of("stone").points, model_of("stone").normals, 0.02)
    table = PairTable.of(points, normals, 0.01)
    assert table.starts[-1] == len(table.first) == len(table.turn)
    assert len(table.starts) == CELLS + 1
    assert (np.diff(table.starts) >= 0).all()
    assert table.turn.min() >= 0
    assert table.turn.max() < TURNS * FINE


def arguments() -> dict[str, list[Any]]:
    """With which each kernel works."""
    i = lambda *shape: np.zeros(shape, dtype=np.int32)  # noqa: E731
    one = np.eye(4)[None]
    grid = [np.zeros((2, 3)), np.ones((2, 3)), i(2, 2, 2, 6), np.zeros(3), 0.5, np.zeros(3)]
    cloud = [np.zeros((3, 3)), np.ones((3, 3))]
    return {
        "vote": [i(CELLS + 1), i(4), i(4), i(3), np.zeros((3, 4)), i(3), 2, 30, 8, i(1, 2, 3)],
        "align": [*grid, *cloud, np.ones(2), one.copy()],
        "partners": [*grid, *cloud, one, i(1, 3), np.zeros((1, 3, 3))],
        "normals": [np.zeros((3, 3)), np.zeros((2, 3)), 0, 2, np.zeros((2, 3))],
        "look": [np.ones((2, 2)), np.ones((2, 2)), 0.0, 0.0, 0.1, *cloud, one, 0.01, 0.01, np.zeros((1, 4))],
    }


@needs_kernels
@pytest.mark.parametrize("name", arguments())
def test_the_kernels_refuse_arrays_that_they_cannot_read(name: str) -> None:
    kernel, given = getattr(compiled, name), arguments()[name]
    kernel(*given)
    for place, argument in enumerate(given):
        if isinstance(argument, np.ndarray):
            for wrong in (argument.astype(np.complex64), argument.astype(np.int16), None, argument[None]):
                with pytest.raises((TypeError, ValueError, BufferError)):
                    kernel(*given[:place], wrong, *given[place + 1 :])
    with pytest.raises(TypeError):
        kernel(*given[:-1])


@needs_kernels
@pytest.mark.parametrize(("name", "place"), [("vote", k) for k in (0, 1, 2, 3, 5)] + [("align", 2), ("partners", 2)])
def test_indices_out_of_range_are_refused(name: str, place: int) -> None:
    given = arguments()[name]
    given[place].reshape(-1)[-1] = 2**31 - 1
    with pytest.raises(ValueError, match="out of the array"):
        getattr(compiled, name)(*given)


@needs_kernels
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_no_number_hangs_or_crashes_the_kernels(value: float) -> None:
    for name, places in {
        "vote": (4,),
        "align": (0, 1, 3, 5, 6, 7, 8, 9),
        "partners": (0, 6, 8),
        "look": (0, 1, 5, 6, 7),
    }.items():
        for place in places:
            given = arguments()[name]
            given[place].reshape(-1)[0] = value
            getattr(compiled, name)(*given)


def test_without_kernels_the_references_do_the_work() -> None:
    program = (
        "import sys; sys.modules['grasping.pose._kernels'] = None  # as where no compiler was found\n"
        "import grasping.pose.kernels as kernels\n"
        "assert kernels.compiled is None"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
