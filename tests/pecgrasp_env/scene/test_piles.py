"""Objects that fell onto each other and into a bin."""

import numpy as np
import pytest
import sapien
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects import make_object
from pecgrasp_env.scene.piles import Bin, drop_at, fill_bin, pile
from pecgrasp_env.scene.placement import PlacementError, Region, outline_of

REGION = Region(0.33, 0.67, -0.25, 0.25)
FLOOR = 0.006  # of the bin


@pytest.fixture(scope="module")
def models():
    return [make_object(name, 3) for name in ("box", "stapler", "mouse", "box", "plug_adapter", "can")]


def heights(model, pose):
    points = Rotation.from_quat(np.roll(pose[3:], -1)).apply(np.concatenate(model.hulls))[:, 2] + pose[2]
    return points.min(), points.max()


@pytest.mark.parametrize("seed", [0, 1])
def test_a_pile_lies_in_its_region_and_on_the_table_the_same_for_one_seed(models, seed):
    poses = pile(models, np.random.default_rng(seed), REGION)
    np.testing.assert_array_equal(poses, pile(models, np.random.default_rng(seed), REGION))
    points = np.concatenate([outline_of(m, p) + p[:2] for m, p in zip(models, poses, strict=True)])
    assert (points >= (REGION.x_min, REGION.y_min)).all()
    assert (points <= (REGION.x_max, REGION.y_max)).all()
    lowest = [heights(m, p)[0] for m, p in zip(models, poses, strict=True)]
    assert min(lowest) == pytest.approx(0, abs=5e-4)


@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_what_fell_into_the_bin_lies_in_it(models, yaw):
    box = Bin(x=0.45, y=-0.1, yaw=yaw)
    poses = fill_bin(models, np.random.default_rng(2), box)
    assert (np.abs(box.local(poses[:, :2])) <= np.array(box.size[:2]) / 2).all()
    lowest = np.array([heights(m, p)[0] for m, p in zip(models, poses, strict=True)])
    assert lowest.min() == pytest.approx(FLOOR, abs=5e-4)
    assert lowest.max() < box.size[2]


def test_one_box_falls_onto_another(models):
    starts = np.tile([0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (2, 1))
    poses = drop_at([models[0], models[3]], starts, np.random.default_rng(0))
    assert heights(models[3], poses[1])[0] == pytest.approx(heights(models[0], poses[0])[1], abs=1e-3)


def test_places_of_the_bin_go_there_and_back():
    box = Bin(x=0.3, y=0.2, yaw=1.1)
    points = np.random.default_rng(0).uniform(-1, 1, (20, 2))
    np.testing.assert_allclose(box.world(box.local(points)), points, atol=1e-12)
    corner = box.boxes()[1][1].p[:2]  # of a wall, 125 mm and half a wall from the middle
    assert np.linalg.norm(corner - (0.3, 0.2)) == pytest.approx(0.125 + FLOOR / 2, abs=1e-6)


def test_the_bin_is_solid_in_a_bare_scene(models):
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem()])
    builder = Bin().add_to(sapien.ActorBuilder())
    assert len(builder.collision_records) == len(builder.visual_records) == 5
    builder.visual_records.clear()
    entity = sapien.Entity()
    entity.add_component(builder.set_physx_body_type("static").build_physx_component())
    scene.add_entity(entity)
    assert len(scene.get_all_actors()) == 1


def test_what_does_not_fit_is_said(models):
    with pytest.raises(PlacementError, match=r"1 objects .* not at rest in a pile"):
        pile(models[:1], np.random.default_rng(0), Region(0.4, 0.45, 0.0, 0.05))
