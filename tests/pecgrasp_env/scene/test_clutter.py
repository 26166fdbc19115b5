"""Which objects are drawn, and how densely they lie."""

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from pecgrasp_env.objects import Catalogue, make_object
from pecgrasp_env.objects.strangers import StrangerMeshes
from pecgrasp_env.scene.clutter import CLOSE_GAP_M, MOST_OBJECTS, lay_out
from pecgrasp_env.scene.draw_objects import askable, draw_classes, draw_instances, draw_strangers
from pecgrasp_env.scene.placement import PlacementError, Region, outline_of, separation
from pecgrasp_env.scene.settling import push_together, settle

REGION = Region(0.33, 0.67, -0.25, 0.25)


@pytest.fixture(scope="module")
def models():
    return [make_object(name, 2) for name in ("stapler", "mouse", "plug_adapter", "joypad")]


# ---------------------------------------------------------------------------------------------------------- choice


@given(st.integers(2, 14), st.integers(1, max(MOST_OBJECTS.values())), st.booleans(), st.integers(0, 10**6))
def test_some_class_can_be_asked_for_and_comes_as_often_as_it_should(n_classes, n_objects, twins, seed):
    n_objects = max(n_objects, 2 if twins else 1)
    slots = draw_classes(n_classes, n_objects, twins, np.random.default_rng(seed))
    asked = askable(slots, twins)
    assert len(slots) == n_objects
    assert len(asked) > 0
    assert all((slots == slots[i]).sum() == (2 if twins else 1) for i in asked)
    assert len(np.unique(slots)) == min(n_objects - twins, n_classes)


def test_every_slot_and_every_class_can_be_the_asked_for_one():
    seen = [[], []]
    for seed in range(200):
        slots = draw_classes(5, 8, False, np.random.default_rng(seed))
        asked = askable(slots, False)
        seen[0] += asked.tolist()
        seen[1] += slots[asked].tolist()
    assert set(seen[0]) == set(range(8))
    assert set(seen[1]) == set(range(5))


def test_twins_are_two_instances_where_there_are_two():
    source = Catalogue(("mouse", "pliers"), instances_per_class=2)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        names = [model.instance for model in draw_instances(source, ["mouse", "pliers", "mouse"], rng)]
        assert len(set(names)) == 3
    lone = Catalogue(("mouse",), instances_per_class=1)
    assert len(draw_instances(lone, ["mouse", "mouse"], np.random.default_rng(0))) == 2


# ---------------------------------------------------------------------------------------------------------- clutter


def outlines(models, poses):
    return [outline_of(model, pose) + pose[:2] for model, pose in zip(models, poses, strict=True)]


@pytest.mark.parametrize("seed", range(4))
def test_close_objects_have_a_neighbour_at_the_gap_and_none_nearer(models, seed):
    poses = lay_out(models, np.random.default_rng(seed), REGION, "close")
    shapes = outlines(models, poses)
    gaps = np.array([[np.inf if a is b else separation(a, b) for b in shapes] for a in shapes])
    assert (gaps.min(axis=1) >= CLOSE_GAP_M[0] - 1e-6).all()
    assert (gaps.min(axis=1)[1:] <= CLOSE_GAP_M[1] + 1e-3).all()
    points = np.concatenate(shapes)
    assert (points.min(axis=0) >= (REGION.x_min - 1e-9, REGION.y_min - 1e-9)).all()
    assert (points.max(axis=0) <= (REGION.x_max + 1e-9, REGION.y_max + 1e-9)).all()


def test_a_crowd_that_finds_no_room_as_it_comes_is_laid_out_the_large_ones_first(models):
    tight = Region(0.39, 0.61, -0.1375, 0.1375)
    poses = lay_out(models, np.random.default_rng(5), tight, "close")  # in its order none of forty tries has room
    points = np.concatenate(outlines(models, poses))
    assert (points.min(axis=0) >= (tight.x_min - 1e-9, tight.y_min - 1e-9)).all()
    assert (points.max(axis=0) <= (tight.x_max + 1e-9, tight.y_max + 1e-9)).all()
    with pytest.raises(PlacementError):
        lay_out(models, np.random.default_rng(0), Region(0.45, 0.55, -0.05, 0.05), "close")


def test_touching_objects_lean_on_each_other_and_rest(models):
    poses = lay_out(models[:3], np.random.default_rng(1), REGION, "touching")
    shapes = outlines(models[:3], poses)
    assert all(min(separation(a, b) for b in shapes if b is not a) < 0.002 for a in shapes)
    again, at_rest, touching = push_together(models[:3], poses)
    assert at_rest.all()
    assert touching.all()
    assert np.abs(again[:, :3] - poses[:, :3]).max() < 0.02  # pushed once more they may turn, nothing is thrown out


def test_the_generator_alone_decides(models):
    for clutter in ("close", "touching"):
        first, second = (lay_out(models[:2], np.random.default_rng(5), REGION, clutter) for _ in range(2))
        assert np.array_equal(first, second)


def test_a_crowd_that_does_not_fit_is_named(models):
    with pytest.raises(PlacementError, match=r"joypad_0002.*clutter='close'"):
        lay_out(models, np.random.default_rng(0), Region(0.4, 0.5, 0.0, 0.1), "close")


def test_what_lies_apart_stays_where_the_fall_left_it(models):
    poses = lay_out(models, np.random.default_rng(3), REGION)
    ends, at_rest = settle(models, poses)
    assert at_rest.all()
    assert np.abs(ends[:, :3] - poses[:, :3]).max() < 1e-3


def test_strangers_that_roll_on_are_not_drawn(tmp_path):
    box, ball = trimesh.creation.box((0.05, 0.04, 0.03)), trimesh.creation.icosphere(5, 0.08)
    ball.export(tmp_path / "ball.ply")
    box.export(tmp_path / "box.ply")
    strangers = StrangerMeshes(tmp_path)
    drawn = draw_strangers(strangers, 3, [], np.random.default_rng(0))
    assert [model.instance for model in drawn] == ["box"] * 3
    assert [model.instance for model in draw_strangers(strangers, 1, [], np.random.default_rng(0), [0])] == ["ball"]
