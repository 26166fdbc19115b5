"""Deformed copies: other shapes by seed, closed and right side out, and where they stand in a data set's source."""

import numpy as np
import pytest
import trimesh

from pecgrasp_env.capture import CaptureConfig, CaptureError, ObjectsConfig
from pecgrasp_env.capture.shard_plan import allot, open_source
from pecgrasp_env.objects import Catalogue, ObjectError, make_object
from pecgrasp_env.objects.deform import MOST, Deformed, deformed
from pecgrasp_env.objects.meshing.free_form import FreeForm
from pecgrasp_env.objects.model import assemble
from pecgrasp_env.objects.procedural import further_kinds
from pecgrasp_env.objects.procedural.proportions import KINDS


@pytest.mark.parametrize("seed", range(20))
def test_the_strongest_map_keeps_a_mesh_closed_and_right_side_out(seed):
    half = np.array([0.1, 0.03, 0.01])
    ball = trimesh.creation.icosphere(4)
    moved = ball.copy()
    free_form = FreeForm(-half, half, MOST, np.random.default_rng(seed))
    moved.vertices = free_form(ball.vertices * half)
    assert moved.is_watertight
    assert moved.is_winding_consistent
    assert moved.volume > 0
    step = 1e-6
    points = np.random.default_rng(seed).uniform(-1, 1, (500, 3)) * half
    moves = [(free_form(points + step * e) - free_form(points - step * e)) / (2 * step) for e in np.eye(3)]
    assert np.linalg.det(np.stack(moves, axis=2)).min() > 0


def test_no_strength_moves_nothing():
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    free_form = FreeForm(-np.ones(3), np.ones(3), 0.0, np.random.default_rng(1))
    np.testing.assert_allclose(free_form(points), points, atol=1e-12)


def test_hulls_move_with_the_surface_and_mass_with_the_volume():
    model = make_object("can", 0)
    other = deformed(model, 0.3, np.random.default_rng(3))
    assert other.mass / model.mass == pytest.approx(other.volume / model.volume)
    seen = other.visual_mesh().bounds
    felt = np.concatenate(other.hulls)
    np.testing.assert_allclose(felt.min(axis=0), seen[0], atol=0.002)
    np.testing.assert_allclose(felt.max(axis=0), seen[1], atol=0.002)


def test_copies_stand_behind_the_originals_and_are_the_same_whoever_draws_them():
    base = Catalogue(("can", "box"), 2)
    source = Deformed(base, 2, 0.2)
    names = ["can_0000", "can_0001", "can_0000~1", "can_0001~1", "can_0000~2", "can_0001~2"]
    assert source.names("can") == names
    assert [source.load("can", i).instance for i in range(6)] == names
    assert source.load("can", 1) is base.load("can", 1)
    extents = [source.load("can", i).extents for i in (0, 2, 4)]
    assert len({tuple(e.round(5)) for e in extents}) == 3
    np.testing.assert_array_equal(Deformed(base, 2, 0.2).load("can", 4).hulls[0], source.load("can", 4).hulls[0])
    assert source.origin("can", 4) == "procedural catalogue, deformed"


def test_a_set_records_them_and_one_without_says_nothing_of_them():
    plain = ObjectsConfig(classes=("can",), instances_per_class=2)
    config = CaptureConfig(objects=ObjectsConfig(classes=("can",), instances_per_class=2, deformations=2))
    assert len(allot(config, open_source(config))[0].instances) == 6
    assert config.described()["objects"]["deformations"] == 2
    unsaid = CaptureConfig(objects=plain).described()["objects"]
    assert not {"deformations", "deformation", "families"} & set(unsaid)


def test_a_manifest_says_of_each_copy_what_it_is_a_copy_of():
    objects = ObjectsConfig(classes=("can", "box"), instances_per_class=2, deformations=1, strangers=2)
    config = CaptureConfig(objects=objects)
    manifest = allot(config, open_source(config))[0]
    names = [entry["name"] for entry in manifest.instances]
    assert [names[i] for i in manifest.originals] == [name.partition("~")[0] for name in names]
    assert manifest.originals.tolist() == [0, 1, 0, 1, 4, 5, 4, 5, 8, 9]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"deformations": -1}, "deformations must not be negative, got -1"),
        ({"deformation": 0.5}, "deformation must be above 0 and at most 0.4, got 0.5"),
        ({"families": "broad"}, "families 'broad' does not exist; choose one of narrow, wide"),
        ({"families": "wide", "source": "ycb"}, "families=wide is of the catalogue"),
    ],
)
def test_settings_out_of_range_are_named(settings, message):
    with pytest.raises(CaptureError, match=message):
        ObjectsConfig(**settings)
    with pytest.raises(ObjectError, match="deformation must be"):
        Deformed(Catalogue(("can",), 1), 1, 0.0)


@pytest.mark.parametrize("name", ["can", "box", "bowl", "mug", "wire_cutter", "clamp"])
def test_wide_families_draw_within_the_extents_of_a_kind(name):
    assert sum(kind.share for kind in KINDS[name]) == pytest.approx(1)
    for seed in range(4):
        extents = make_object(name, seed, "wide").extents * 1000
        assert any(
            all(low - 0.5 <= e <= high + 0.5 for e, (low, high) in zip(extents, (k.x, k.y, k.z), strict=True))
            for k in KINDS[name]
        ), extents


@pytest.mark.parametrize("name", further_kinds.__all__)
@pytest.mark.parametrize("seed", [0, 1])
def test_further_kinds_are_closed_and_what_is_felt_is_what_is_seen(name, seed):
    pieces, mass = getattr(further_kinds, name)(np.random.default_rng(seed))
    for shape, _ in pieces:
        mesh = trimesh.Trimesh(shape.vertices, shape.faces)  # corners that coincide are joined
        assert mesh.is_watertight
        assert mesh.volume > 0
    model = assemble("thing", name, pieces, mass)
    seen, felt = model.visual_mesh().bounds, np.concatenate(model.hulls)
    np.testing.assert_allclose(felt.min(axis=0), seen[0], atol=0.0025)
    np.testing.assert_allclose(felt.max(axis=0), seen[1], atol=0.0025)


def test_a_ramekin_is_hollow():
    (dish, _), *_ = further_kinds.ramekin(np.random.default_rng(0))[0]
    height = dish.vertices[:, 2].max()
    floor = dish.vertices[np.linalg.norm(dish.vertices[:, :2], axis=1) < 1][:, 2].max()
    assert floor < 0.4 * height
