"""A gripper drawn to scale from its data: palm, cranks, fingers and pads as small triangle meshes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasping.gripper import Gripper

_BODY_RGB, _FINGER_RGB, _PAD_RGB = (108, 120, 140), (150, 161, 178), (72, 80, 95)
# Shares of the gripper's own measures that make its likeness; the 2F-140's knuckles come out at their true place.
_PALM_RADIUS_OF_STROKE, _KNUCKLE_OF_PALM_DEPTH, _KNUCKLE_OF_RADIUS = 0.268, 0.826, 0.815


@dataclass(frozen=True)
class GripperPart:
    """vertices: (V, 3) metres in the part's frame; faces: (F, 3), outward by the right hand. T_grasp_part: (4, 4)."""

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    rgb: tuple[int, int, int]
    T_grasp_part: np.ndarray


def gripper_parts(gripper: Gripper, opening: float) -> list[GripperPart]:
    """The parts at an opening (metres) in the grasp frame: origin midway between the pads, +z approach, +x closing.

    Pads, palm, the distance to the flange and the cranks' swing are the gripper's own; the outline of the fingers, and
    of a palm without measures, is a likeness. A part's mesh does not depend on the opening, only its pose does.
    """
    pad = (gripper.finger_thickness, gripper.finger_width, gripper.pad_length)
    outward = opening / 2 + gripper.finger_thickness / 2
    flange = -gripper.pad_depth(opening)
    if not gripper.crank_length:
        return _prismatic(gripper, pad, outward, flange)
    radius = gripper.palm_width / 2 or _PALM_RADIUS_OF_STROKE * gripper.stroke
    parts = [GripperPart("palm", *_prism(radius, gripper.palm_depth), _BODY_RGB, _at(0, flange))]
    sine = (opening + gripper.crank_gap) / (2 * gripper.crank_length)
    swing = gripper.crank_length * np.array([sine, 0, np.sqrt(1 - sine * sine)])
    root = np.array([_KNUCKLE_OF_RADIUS * radius, 0, flange + _KNUCKLE_OF_PALM_DEPTH * gripper.palm_depth])
    pad_back = np.array([outward, 0, -0.25 * gripper.pad_length])
    for side, word in ((1, "right"), (-1, "left")):
        mirror = np.array([side, 1, 1])
        for name, start, end, depth in (
            ("crank", root, root + swing, 0.016),
            ("finger", root + swing, pad_back, 0.8 * gripper.finger_thickness),
        ):
            bar = _box((depth, 0.8 * gripper.finger_width, float(np.linalg.norm(end - start)) + 0.8 * depth))
            parts.append(GripperPart(f"{word} {name}", *bar, _FINGER_RGB, _between(start * mirror, end * mirror)))
        parts.append(GripperPart(f"{word} pad", *_box(pad), _PAD_RGB, _at(side * outward, 0)))
    return parts


def _prismatic(gripper: Gripper, pad: tuple[float, float, float], outward: float, flange: float) -> list[GripperPart]:
    """Jaws that slide along a wide palm."""
    across = gripper.palm_width or gripper.stroke + 2 * gripper.finger_thickness
    body = _box((across, gripper.palm_breadth or 2.2 * gripper.finger_width, gripper.palm_depth))
    face = flange + gripper.palm_depth
    parts = [GripperPart("palm", *body, _BODY_RGB, _at(0, flange + gripper.palm_depth / 2))]
    jaw = -gripper.pad_length / 2 - face
    for side, word in ((1, "right"), (-1, "left")):
        if jaw > 0:
            bar = _box((gripper.finger_thickness, 0.8 * gripper.finger_width, jaw))
            parts.append(GripperPart(f"{word} finger", *bar, _FINGER_RGB, _at(side * outward, face + jaw / 2)))
        parts.append(GripperPart(f"{word} pad", *_box(pad), _PAD_RGB, _at(side * outward, 0)))
    return parts


def _box(size: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A box about the origin."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([tri for a, b, c, d in quads for tri in ((a, b, c), (a, c, d))])


def _prism(radius: float, height: float, sides: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """A closed cylinder along +z from the origin."""
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    vertices = np.vstack([np.c_[ring, np.zeros(sides)], np.c_[ring, np.full(sides, height)]])
    faces = []
    for k in range(sides):
        n = (k + 1) % sides
        faces += [(k, n, sides + n), (k, sides + n, sides + k)]
        if 0 < k < sides - 1:
            faces += [(0, n, k), (sides, sides + k, sides + n)]
    return vertices, np.array(faces)


def _at(x: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3], pose[2, 3] = x, z
    return pose


def _between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The pose of a bar along its z whose middle lies between two points of the x-z plane."""
    z = (end - start) / np.linalg.norm(end - start)
    y = np.array([0.0, 1.0, 0.0])
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = np.cross(y, z), y, z
    pose[:3, 3] = (start + end) / 2
    return pose
