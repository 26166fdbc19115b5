"""Write the robot's description as a URDF with its meshes, once, into the user's cache folder."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial

from pec.common.atomic_files import replacing
from pecgrasp_env.robot import arm_lengths, description, kinematics
from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot import visual_surfaces as surfaces
from pecgrasp_env.robot import visuals as appearance
from pecgrasp_env.robot.description import Joint, Link, Shape
from pecgrasp_env.robot.visuals import Part

_SOURCES = (appearance, arm_lengths, description, kinematics, linkage, surfaces)  # what the generated files depend on


def robot_urdf() -> Path:
    """Path of the URDF in `$XDG_CACHE_HOME/pecgrasp` (`~/.cache/pecgrasp`), generated where it is not there yet.

    The folder's name is a hash of the generating sources, so a changed robot never meets an old mesh. The folder
    appears in one step (rename), so processes that start together do not read half of it.
    """
    folder = _cache_root() / f"robot-{_fingerprint()}"
    if not folder.is_dir():
        try:
            with replacing(folder) as unfinished:
                unfinished.mkdir()
                write_description(unfinished)
        except OSError:
            if not folder.is_dir():  # otherwise another process was first, with the same content
                raise
    return folder / "robot.urdf"


def write_description(folder: Path) -> None:
    """Write robot.urdf and the visual meshes it names into `folder`."""
    root = ET.Element("robot", name="ur5_robotiq_2f140")
    parts = appearance.link_parts()
    for name, shapes in parts.items():
        (folder / f"{name}.glb").write_bytes(_glb(shapes))
    for link in description.links():
        root.append(_link(link, drawn=link.name in parts))
    for joint in description.joints():
        root.append(_joint(joint))
    ET.indent(root)
    ET.ElementTree(root).write(folder / "robot.urdf", encoding="utf-8", xml_declaration=False)


def _cache_root() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "pecgrasp"


def _fingerprint() -> str:
    digest = hashlib.sha256()
    for module in (*_SOURCES,):
        digest.update(Path(str(module.__file__)).read_bytes())
    digest.update(Path(__file__).read_bytes())
    return digest.hexdigest()[:16]


def _link(link: Link, drawn: bool) -> ET.Element:
    element = ET.Element("link", name=link.name)
    inertial = ET.SubElement(element, "inertial")
    _origin(inertial, link.com, link.inertia_rpy)
    ET.SubElement(inertial, "mass", value=repr(link.mass))
    ixx, iyy, izz = map(repr, link.inertia)
    ET.SubElement(inertial, "inertia", ixx=ixx, iyy=iyy, izz=izz, ixy="0", ixz="0", iyz="0")
    if drawn:
        geometry = ET.SubElement(ET.SubElement(element, "visual"), "geometry")
        ET.SubElement(geometry, "mesh", filename=f"{link.name}.glb")
    for shape in link.collision:
        _shape(ET.SubElement(element, "collision"), shape)
    return element


def _glb(parts: list[Part]) -> bytes:
    """One binary glTF scene: the parts of a material merged into one mesh."""
    scene = trimesh.Scene()
    for material in dict.fromkeys(material for _, material in parts):
        pieces = [surfaces.shaded(surface) for surface, other in parts if other == material]
        offsets = np.cumsum([0] + [len(vertices) for vertices, _, _ in pieces[:-1]])
        mesh = trimesh.Trimesh(
            np.concatenate([vertices for vertices, _, _ in pieces]),
            np.concatenate([faces + offset for (_, _, faces), offset in zip(pieces, offsets, strict=True)]),
            vertex_normals=np.concatenate([normals for _, normals, _ in pieces]),
            process=False,
        )
        look = PBRMaterial(
            baseColorFactor=[*(round(255 * c) for c in material.color), 255],
            metallicFactor=material.metallic,
            roughnessFactor=material.roughness,
        )
        mesh.visual = trimesh.visual.TextureVisuals(material=look)
        scene.add_geometry(mesh)
    return bytes(scene.export(file_type="glb", include_normals=True))


def _shape(element: ET.Element, shape: Shape) -> None:
    _origin(element, shape.xyz, shape.rpy)
    geometry = ET.SubElement(element, "geometry")
    if len(shape.size) == 3:
        ET.SubElement(geometry, "box", size=_text(shape.size))
    else:
        radius, length = shape.size
        ET.SubElement(geometry, "cylinder", radius=repr(radius), length=repr(length))


def _joint(joint: Joint) -> ET.Element:
    element = ET.Element("joint", name=joint.name, type="fixed" if joint.limits is None else "revolute")
    _origin(element, joint.xyz, joint.rpy)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    if joint.limits is not None:
        ET.SubElement(element, "axis", xyz=_text(joint.axis))
        low, high = (repr(float(limit)) for limit in joint.limits)
        ET.SubElement(element, "limit", lower=low, upper=high, effort=repr(joint.effort), velocity=repr(3.1416))
    if joint.mimic is not None:
        ET.SubElement(element, "mimic", joint=joint.mimic, multiplier="1", offset="0")
    return element


def _origin(parent: ET.Element, xyz: tuple[float, ...], rpy: tuple[float, ...]) -> None:
    ET.SubElement(parent, "origin", xyz=_text(xyz), rpy=_text(rpy))


def _text(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)
