"""The generated description: one consistent robot, closed meshes, and a cache that never shows half a robot."""

import os
from concurrent.futures import ThreadPoolExecutor
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import trimesh

from pecgrasp_env.robot import description
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot import visual_surfaces as surfaces
from pecgrasp_env.robot import visuals as appearance
from pecgrasp_env.robot.urdf import robot_urdf


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "pecgrasp"


def test_the_urdf_is_written_once_below_the_cache_home(cache):
    urdf = robot_urdf()
    assert urdf.parent.parent == cache
    written = {path: path.stat().st_mtime_ns for path in urdf.parent.iterdir()}
    assert robot_urdf() == urdf
    assert {path: path.stat().st_mtime_ns for path in urdf.parent.iterdir()} == written


def test_processes_that_start_together_get_one_whole_robot(cache):
    with ThreadPoolExecutor(4) as pool:
        (urdf,) = set(pool.map(lambda _: robot_urdf(), range(4)))
    assert os.listdir(cache) == [urdf.parent.name]
    meshes = {mesh.get("filename") for mesh in ET.parse(urdf).getroot().iter("mesh")}
    assert len(meshes) > 10
    for mesh in meshes:
        assert len(trimesh.load(urdf.parent / mesh, force="mesh").faces) > 100


def test_a_failed_write_leaves_nothing_behind(cache, monkeypatch):
    monkeypatch.setattr(appearance, "link_parts", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        robot_urdf()
    assert os.listdir(cache) == []


def test_links_and_joints_form_one_tree():
    links = [link.name for link in description.links()]
    joints = description.joints()
    assert len(set(links)) == len(links)
    assert sorted(joint.child for joint in joints) == sorted(set(links) - {"base_link"})
    assert all(joint.parent in links for joint in joints)


def test_masses_are_the_makers():
    mass = {link.name: link.mass for link in description.links()}
    assert sum(mass[name] for name in description.GRIPPER_LINKS) == pytest.approx(1.025)
    arm = sum(value for name, value in mass.items() if name not in (*description.GRIPPER_LINKS, "tcp", "wrist_camera"))
    assert arm == pytest.approx(4.0 + 3.7 + 8.393 + 2.33 + 1.219 + 1.219 + 0.1879)


@pytest.mark.parametrize("link", sorted(appearance.link_parts()))
def test_every_drawn_part_is_closed_and_faces_outwards(link):
    for surface, _ in appearance.link_parts()[link]:
        mesh = trimesh.Trimesh(surface.vertices, surface.faces)
        assert mesh.is_watertight
        assert mesh.volume > 0


def test_shading_normals_are_unit_length_and_point_outwards():
    vertices, normals, faces = surfaces.shaded(surfaces.tube(0.05, 0.0, 0.2))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    corners = vertices[faces]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    assert (np.einsum("fij,fj->fi", normals[faces], flat) > 0.7).all()


def test_what_is_drawn_is_what_collides():
    parts = appearance.link_parts()
    for link in description.links():
        if link.collision:
            drawn = np.concatenate([surface.vertices for surface, _ in parts[link.name]])
            solid = np.concatenate([_corners(shape) for shape in link.collision])
            np.testing.assert_allclose(drawn.min(0), solid.min(0), atol=0.021, err_msg=link.name)
            np.testing.assert_allclose(drawn.max(0), solid.max(0), atol=0.021, err_msg=link.name)


@pytest.mark.parametrize(("name", "inward"), [("left_finger", 1), ("right_finger", -1)])
def test_the_drawn_pad_is_the_pad_of_the_physics(name, inward):
    (pad,) = [surface for surface, material in appearance.link_parts()[name] if material is appearance.RUBBER]
    size = [linkage.PAD_WIDTH, linkage.PAD_THICKNESS, linkage.PAD_LENGTH]
    centre = [0, inward * linkage.PAD_CENTRE_Y, linkage.PAD_CENTRE_Z]
    np.testing.assert_allclose(np.ptp(pad.vertices, axis=0), size, atol=2e-4)
    np.testing.assert_allclose((pad.vertices.min(0) + pad.vertices.max(0)) / 2, centre, atol=1e-4)
    (link,) = [link for link in description.links() if link.name == name]
    assert (link.collision[0].size, link.collision[0].xyz) == (tuple(size), tuple(centre))


def _corners(shape):
    """Corners of a box, or of the box around a cylinder, in the link's frame."""
    half = (
        np.array(shape.size) / 2
        if len(shape.size) == 3
        else np.array([shape.size[0], shape.size[0], shape.size[1] / 2])
    )
    corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T * half
    return corners @ trimesh.transformations.euler_matrix(*shape.rpy)[:3, :3].T + shape.xyz
