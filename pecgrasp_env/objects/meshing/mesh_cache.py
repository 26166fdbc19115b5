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
from PIL import Image
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from pec.common.atomic_files import write_whole
from pecgrasp_env.objects.meshing.convex_hulls import convex_hull

CREASE = np.radians(38)  # faces that meet at a larger angle keep an edge between them
COLLISION_UNIT = 0.1  # m; PhysX drops vertices within 0.7 mm of a hull's planes: written ten times as large, 0.07 mm
_CROWDED = 128  # faces at a vertex; beyond, their directions are taken together
_PAIRS_AT_ONCE = 1 << 20
FORMAT = b"2"  # change it when the way of writing changes, so that older files are not taken for new ones


@dataclass(frozen=True, eq=False)
class Part:
    """A coloured piece of the surface."""

    vertices: np.ndarray  # (V, 3) float32, m, object frame
    faces: np.ndarray  # (F, 3) int32, counter-clockwise seen from outside
    color: tuple[float, float, float, float]  # linear RGBA in 0..1; of a texture the mean
    texture: np.ndarray | None = None  # (H, W, 3) uint8, sRGB, first row on top
    uv: np.ndarray | None = None  # (F, 3, 2) float32, where the faces' corners lie in the texture, v from below


def cache_folder() -> Path:
    """`$XDG_CACHE_HOME/pecgrasp/objects`, or the same below `~/.cache`."""
    root = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(root) / "pecgrasp" / "objects"


def visual_file(parts: Sequence[Part]) -> Path:
    """A .glb of the parts with smooth normals and their colours, in the cache folder."""
    digest = hashlib.sha256(FORMAT)
    for part in parts:
        digest.update(part.vertices.tobytes() + part.faces.tobytes() + repr(part.color).encode())
        if part.texture is not None and part.uv is not None:
            digest.update(part.uv.tobytes() + part.texture.tobytes() + repr(part.texture.shape).encode())
    path = cache_folder() / f"{digest.hexdigest()[:32]}.visual.glb"
    if not path.exists():
        scene = trimesh.Scene()
        for i, part in enumerate(parts):
            vertices, faces, normals, uv = with_normals(part.vertices, part.faces, part.uv)
            material = PBRMaterial(metallicFactor=0.0, roughnessFactor=0.6)
            if part.texture is None:
                material.baseColorFactor = [round(255 * c) for c in part.color]
            else:
                material.baseColorTexture = Image.fromarray(part.texture)
            visual = TextureVisuals(uv=uv, material=material)
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


def with_normals(
    vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices, faces, vertex normals and texture coordinates, smooth within CREASE and sharp beyond it.

    vertices (V, 3), faces (F, 3), uv (F, 3, 2) or None -> (V', 3) float32, (F', 3), (V', 3) float32, (V', 2) or None: a
    vertex is repeated once for each normal and each place in the texture that it has. Faces without area are left out.
    """
    corners = vertices[faces].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    del corners
    area = np.linalg.norm(normal, axis=1)
    kept = area > 1e-14
    faces, normal, area = faces[kept], normal[kept], area[kept]
    # Vertices at one place are one, whatever their index.
    _, place = _numbered(list(np.round(vertices, 7).T))
    corner_place = place[faces].reshape(-1)
    summed = _smooth_normals(normal, normal / area[:, None], corner_place)
    keys = [corner_place, *np.round(summed.T * 1000).astype(np.int16)]
    if uv is not None:
        uv = uv[kept].reshape(-1, 2)
        keys += list(uv.T)
    representative, index = _numbered(keys)
    return (
        vertices[faces.reshape(-1)[representative]].astype(np.float32),
        index.reshape(-1, 3),
        summed[representative].astype(np.float32),
        None if uv is None else uv[representative],
    )


def _numbered(keys: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Rows, given as columns (N,), numbered in their order: the first row of each number, and each row's number."""
    order = np.lexsort(keys[::-1])  # stable
    new = np.zeros(len(order), bool)
    new[:1] = True
    for key in keys:
        new[1:] |= key[order][1:] != key[order][:-1]
    number = np.empty(len(order), np.int32)
    number[order] = np.cumsum(new) - 1
    return order[new], number


def _smooth_normals(normal: np.ndarray, unit: np.ndarray, corner_place: np.ndarray) -> np.ndarray:
    """Of each corner (3F, 3) the mean direction of the faces at its place that meet its own face smoothly.

    normal: (F, 3), as long as the face is large. unit: the same of length 1. corner_place: (3F,) numbers of places.
    """
    order = np.argsort(corner_place, kind="stable")
    place_start = np.searchsorted(corner_place[order], np.arange(corner_place.max() + 2))
    valence = np.diff(place_start)[corner_place]
    summed = np.zeros((len(corner_place), 3))
    few = np.flatnonzero(valence <= _CROWDED)
    ends = np.cumsum(valence[few])
    blocks = np.searchsorted(ends, np.arange(_PAIRS_AT_ONCE, ends[-1] if len(ends) else 0, _PAIRS_AT_ONCE))
    for block in np.split(few, blocks):  # a million faces have some 18 million pairs
        of_block = valence[block]
        # All pairs (corner, corner at the same place).
        first = np.repeat(block, of_block)
        within = np.arange(len(first)) - np.repeat(np.cumsum(of_block) - of_block, of_block)
        second = order[place_start[corner_place[first]] + within]
        smooth = np.einsum("ij,ij->i", unit[first // 3], unit[second // 3]) > np.cos(CREASE)
        np.add.at(summed, first[smooth], normal[second[smooth] // 3])
    for place in np.flatnonzero(np.diff(place_start) > _CROWDED):
        corners = order[place_start[place] : place_start[place + 1]]
        # Directions alike within some 3 degrees are taken together: thousands of faces would make millions of pairs.
        cells, cell = np.unique(np.round(16 * unit[corners // 3]).astype(np.int64), axis=0, return_inverse=True)
        sums = np.zeros((len(cells), 3))
        np.add.at(sums, cell.reshape(-1), normal[corners // 3])
        direction = cells / np.linalg.norm(cells, axis=1, keepdims=True)
        summed[corners] = ((direction @ direction.T > np.cos(CREASE)) @ sums)[cell.reshape(-1)]
    summed /= np.linalg.norm(summed, axis=1, keepdims=True)
    return summed
