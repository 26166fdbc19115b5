"""Meshes as files in a cache folder: SAPIEN's builders, ManiSkill's parallel scenes included, load shapes by file name.

A file is named by the hash of its content, so that it never changes, and appears whole (temporary name, then rename),
so that processes may share the folder. SAPIEN keeps a file's mesh in memory after its first use.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from pec.common.atomic_files import write_whole
from pecgrasp_env.objects.meshing.convex_hulls import convex_hull

CREASE = np.radians(38)  # faces that meet at a larger angle keep an edge between them
COLLISION_UNIT = 0.1  # m; PhysX drops vertices within 0.7 mm of a hull's planes: written ten times as large, 0.07 mm
FORMAT = b"2"  # change it when the way of writing changes, so that older files are not taken for new ones


@dataclass(frozen=True, eq=False)
class Part:
    """A coloured piece of the surface."""

    vertices: np.ndarray  # (V, 3) float32, m, object frame
    faces: np.ndarray  # (F, 3) int32, counter-clockwise seen from outside
    color: tuple[float, float, float, float]  # linear RGBA in 0..1


def cache_folder() -> Path:
    """`$XDG_CACHE_HOME/pecgrasp/objects`, or the same below `~/.cache`."""
    root = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(root) / "pecgrasp" / "objects"


def visual_file(parts: Sequence[Part]) -> Path:
    """A .glb of the parts with smooth normals and their colours, in the cache folder."""
    digest = hashlib.sha256(FORMAT)
    for part in parts:
        digest.update(part.vertices.tobytes() + part.faces.tobytes() + repr(part.color).encode())
    path = cache_folder() / f"{digest.hexdigest()[:32]}.visual.glb"
    if not path.exists():
        scene = trimesh.Scene()
        for i, part in enumerate(parts):
            vertices, faces, normals = with_normals(part.vertices, part.faces)
            material = PBRMaterial(
                baseColorFactor=[round(255 * c) for c in part.color], metallicFactor=0.0, roughnessFactor=0.6
            )
            visual = TextureVisuals(material=material)
            mesh = trimesh.Trimesh(vertices, faces, vertex_normals=normals, visual=visual, process=False)
            scene.add_geometry(mesh, geom_name=f"part_{i}")
        write_whole(path, export_glb(scene, include_normals=True))
    return path


def collision_file(hulls: Sequence[np.ndarray]) -> Path:
    """A .glb with one mesh a convex part, in units of COLLISION_UNIT, in the cache folder."""
    digest = hashlib.sha256(FORMAT)
    for points in hulls:
        digest.update(points.tobytes() + b"/")
    path = cache_folder() / f"{digest.hexdigest()[:32]}.convex.glb"
    if not path.exists():
        scene = trimesh.Scene()
        for i, points in enumerate(hulls):
            mesh = trimesh.Trimesh(points / COLLISION_UNIT, convex_hull(points).simplices, process=False)
            scene.add_geometry(mesh, geom_name=f"hull_{i}")
        write_whole(path, export_glb(scene, include_normals=False))
    return path


def with_normals(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces and vertex normals, smooth within CREASE and sharp beyond it.

    vertices (V, 3), faces (F, 3) -> (V', 3) float32, (F', 3), (V', 3) float32: a vertex is repeated once for each
    normal it carries. Faces without area are left out.
    """
    corners = vertices[faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    kept = area > 1e-14
    faces, normal, area = faces[kept], normal[kept], area[kept]
    unit = normal / area[:, None]
    # Vertices at one place are one, whatever their index.
    _, place = np.unique(np.round(vertices, 7), axis=0, return_inverse=True)
    corner_place = place.reshape(-1)[faces].reshape(-1)
    corner_face = np.repeat(np.arange(len(faces)), 3)
    order = np.argsort(corner_place, kind="stable")
    place_start = np.searchsorted(corner_place[order], np.arange(corner_place.max() + 2))
    valence = np.diff(place_start)[corner_place]
    # All pairs (corner, corner at the same place).
    first = np.repeat(np.arange(len(corner_place)), valence)
    within = np.arange(len(first)) - np.repeat(np.cumsum(valence) - valence, valence)
    second = order[place_start[corner_place[first]] + within]
    smooth = np.einsum("ij,ij->i", unit[corner_face[first]], unit[corner_face[second]]) > np.cos(CREASE)
    summed = np.zeros((len(corner_place), 3))
    np.add.at(summed, first[smooth], normal[corner_face[second[smooth]]])
    summed /= np.linalg.norm(summed, axis=1, keepdims=True)
    key = np.column_stack([corner_place, np.round(summed * 1000)]).astype(np.int64)
    _, representative, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    points = vertices[faces.reshape(-1)[representative]]
    return (
        points.astype(np.float32),
        index.reshape(-1, 3),
        summed[representative].astype(np.float32),
    )
