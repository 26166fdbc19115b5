"""One object: what is seen, what is touched, what it weighs, and how it is put into a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sapien
import trimesh

from pecgrasp_env.objects.meshing.convex_hulls import convex_hull, hull_volume
from pecgrasp_env.objects.meshing.mesh_cache import COLLISION_UNIT, Part, collision_file, visual_file
from pecgrasp_env.objects.meshing.shapes import Shape, join

LIGHTEST = 0.02  # kg; below it PhysX throws an object out of a gripper that squeezes with 125 N
FRICTION = 0.6  # plastic or painted metal against rubber pads and a table

Color = tuple[float, float, float]
Draft = tuple[list[tuple[Shape, Color]], float]  # coloured shapes in mm, and the mass in kg


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """An instance of a class.

    Object frame: origin at the centre of mass (of the hulls, each of the same density), z up as the object lies or
    stands on a table, x along its longest horizontal direction. Metres and kilograms.
    """

    class_name: str
    instance: str
    parts: tuple[Part, ...]
    hulls: tuple[np.ndarray, ...]  # convex collision parts, vertices (K, 3) float32, m
    mass: float  # kg, >= LIGHTEST
    mended: tuple[str, ...] = ()  # what was mended in the mesh of a file, or is missing beside it

    @cached_property
    def extents(self) -> np.ndarray:
        """Size of the axis-aligned box around the visual surface, (3,) m."""
        points = np.concatenate([p.vertices for p in self.parts])
        return points.max(axis=0) - points.min(axis=0)

    @cached_property
    def volume(self) -> float:
        """Sum of the hulls' volumes, m³."""
        return sum(hull_volume(h) for h in self.hulls)

    def visual_mesh(self) -> trimesh.Trimesh:
        """All parts as one mesh with face colours, object frame, metres."""
        starts = np.cumsum([0] + [len(p.vertices) for p in self.parts[:-1]])
        return trimesh.Trimesh(
            np.concatenate([p.vertices for p in self.parts]),
            np.concatenate([p.faces + s for p, s in zip(self.parts, starts, strict=True)]),
            face_colors=np.concatenate([np.tile(p.color, (len(p.faces), 1)) for p in self.parts]),
            process=False,
        )

    def add_to(
        self, builder: Any, *, collision: bool = True, material: sapien.physx.PhysxMaterial | None = None
    ) -> Any:
        """Give the shape, the convex collision parts and the mass to an actor builder; returns the builder.

        Works for SAPIEN's and ManiSkill's builders, for any number of sub-scenes. The meshes go through files in the
        cache folder (`mesh_files.cache_folder`), written at first use, named by their content.
        material: friction of the surface; without one, both coefficients are FRICTION and nothing bounces.
        """
        builder.add_visual_from_file(str(visual_file(self.parts)))
        if collision:
            builder.add_multiple_convex_collisions_from_file(
                str(collision_file(self.hulls)),
                scale=(COLLISION_UNIT,) * 3,
                material=material or sapien.physx.PhysxMaterial(FRICTION, FRICTION, 0.0),
                density=self.mass / self.volume,
            )
        return builder


def assemble(class_name: str, instance: str, pieces: Sequence[tuple[Shape, Color]], mass: float) -> ObjectModel:
    """A model from coloured shapes in millimetres: scaled to metres, centred at its centre of mass, one part a colour.

    mass in kg. Where hulls overlap, the overlap counts twice, as it does in PhysX.
    """
    hulls = [h * 1e-3 for shape, _ in pieces for h in shape.hulls]
    centre = centre_of_mass(hulls)
    by_color: dict[Color, list[Shape]] = {}
    for shape, color in pieces:
        by_color.setdefault(color, []).append(shape)
    parts = []
    for color, shapes in by_color.items():
        whole = join(shapes)
        vertices = (whole.vertices * 1e-3 - centre).astype(np.float32)
        parts.append(Part(vertices, whole.faces.astype(np.int32), (*color, 1.0)))
    centred = tuple((h - centre).astype(np.float32) for h in hulls)
    return ObjectModel(class_name, instance, tuple(parts), centred, max(float(mass), LIGHTEST))


def centre_of_mass(hulls: Sequence[np.ndarray]) -> np.ndarray:
    """Centre of mass (3,) of convex pieces (K, 3) of one density."""
    total, moment = 0.0, np.zeros(3)
    for points in hulls:
        hull = convex_hull(points)
        apex = points.mean(axis=0)
        # Each facet and the apex span a tetrahedron.
        corners = hull.points[hull.simplices]
        volumes = np.abs(
            np.einsum("ij,ij->i", np.cross(corners[:, 0] - apex, corners[:, 1] - apex), corners[:, 2] - apex)
        )
        total += volumes.sum() / 6
        moment += (volumes[:, None] / 6 * (corners.sum(axis=1) + apex) / 4).sum(axis=0)
    return moment / total
