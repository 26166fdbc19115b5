"""Objects in the simulator: mass, rest, cached files, both kinds of builder."""

import numpy as np
import pytest
import sapien
import torch
from mani_skill.envs.scene import ManiSkillScene
from mani_skill.envs.utils.system.backend import parse_sim_and_render_backend

from pecgrasp_env.objects import CLASSES, make_object
from pecgrasp_env.objects.meshing.convex_hulls import convex_hull
from pecgrasp_env.objects.meshing.mesh_cache import cache_folder, collision_file, visual_file


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def new_scene() -> sapien.Scene:
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
    scene.set_timestep(0.01)
    return scene


def body_of(entity: sapien.Entity) -> sapien.physx.PhysxRigidDynamicComponent:
    return entity.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)


@pytest.mark.parametrize("seeds", [range(2, 4), pytest.param(range(4, 8), marks=pytest.mark.slow)])
@pytest.mark.parametrize("class_name", CLASSES)
def test_physx_touches_the_hulls_that_it_was_given(class_name, seeds):
    """It replaces what it cannot cook by a box: a thin disc by a square."""
    for seed in seeds:
        model = make_object(class_name, seed)
        body = model.add_to(sapien.ActorBuilder()).build_physx_component()
        for hull, shape in zip(model.hulls, body.collision_shapes, strict=True):
            equations = convex_hull(hull).equations
            cooked = shape.vertices * shape.scale
            assert (cooked @ equations[:, :3].T + equations[:, 3]).max() < 1e-4


@pytest.mark.parametrize("class_name", CLASSES)
def test_an_object_comes_to_rest_on_a_plane(class_name):
    model = make_object(class_name, 2)
    scene = new_scene()
    scene.add_ground(0, render=False)
    lowest = min(float(h[:, 2].min()) for h in model.hulls)
    builder = model.add_to(scene.create_actor_builder())
    builder.set_initial_pose(sapien.Pose([0, 0, 0.005 - lowest]))
    entity = builder.build("object")
    body = body_of(entity)
    body.sleep_threshold = 0.0
    assert len(body.collision_shapes) == len(model.hulls)
    assert body.mass == pytest.approx(model.mass, rel=0.01)
    np.testing.assert_allclose(body.cmass_local_pose.p, 0, atol=2e-4)

    fastest = 0.0
    for _ in range(200):
        scene.step()
        fastest = max(fastest, float(np.linalg.norm(body.linear_velocity)))
    assert fastest < 0.6  # falls 5 mm, may tip over its pins, is not shot away
    before = entity.pose
    for _ in range(100):
        scene.step()
    assert np.linalg.norm(entity.pose.p - before.p) < 2e-4
    assert 2 * np.arccos(min(1.0, abs(float(entity.pose.q @ before.q)))) < np.radians(0.3)
    assert np.linalg.norm(entity.pose.p[:2]) < 0.03
    if class_name != "plug_adapter":  # it rolls onto its flat side and a pin
        assert entity.pose.to_transformation_matrix()[2, 2] > np.cos(np.radians(8))
    points = entity.pose.to_transformation_matrix()[:3, :3] @ np.concatenate([p.vertices for p in model.parts]).T
    assert abs((points[2] + entity.pose.p[2]).min()) < 0.003


def test_files_are_written_once_and_whole(tmp_path):
    model = make_object("plug_adapter", 4)
    first = visual_file(model.parts), collision_file(model.hulls)
    assert all(f.parent == cache_folder() == tmp_path / "pecgrasp" / "objects" for f in first)
    stamps = [f.stat().st_mtime_ns for f in first]
    model.add_to(new_scene().create_actor_builder()).build("object")
    assert [f.stat().st_mtime_ns for f in first] == stamps
    assert sorted(cache_folder().iterdir()) == sorted(first)
    assert visual_file(make_object("plug_adapter", 5).parts) != first[0]


def test_what_is_rendered_is_the_visual_mesh_in_its_colours():
    model = make_object("mug", 1)
    shape = sapien.render.RenderShapeTriangleMesh(str(visual_file(model.parts)))
    assert len(shape.parts) == len(model.parts)
    for drawn, part in zip(shape.parts, model.parts, strict=True):
        np.testing.assert_allclose(drawn.vertices.min(axis=0), part.vertices.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(drawn.vertices.max(axis=0), part.vertices.max(axis=0), atol=1e-6)
        np.testing.assert_allclose(drawn.material.base_color, part.color, atol=0.003)


def test_only_to_be_seen():
    entity = make_object("can", 0).add_to(new_scene().create_actor_builder(), collision=False).build_kinematic("can")
    component = entity.find_component_by_type(sapien.physx.PhysxRigidDynamicComponent)
    assert len(component.collision_shapes) == 0


def test_maniskill_builds_it_in_several_sub_scenes():
    backend = parse_sim_and_render_backend("physx_cpu", "cpu")
    scene = ManiSkillScene([new_scene() for _ in range(3)], device=torch.device("cpu"), backend=backend)
    model = make_object("stapler", 0)
    builder = model.add_to(scene.create_actor_builder())
    builder.initial_pose = sapien.Pose([0.5, 0, 0.1])
    builder.set_scene_idxs([0, 2])
    actor = builder.build("stapler")
    assert len(actor._objs) == 2
    for entity in actor._objs:
        assert body_of(entity).mass == pytest.approx(model.mass, rel=0.01)
        assert len(body_of(entity).collision_shapes) == len(model.hulls)
        assert len(entity.find_component_by_type(sapien.render.RenderBodyComponent).render_shapes) == 1
    np.testing.assert_allclose(actor.pose.p.numpy(), [[0.5, 0, 0.1]] * 2, atol=1e-6)
