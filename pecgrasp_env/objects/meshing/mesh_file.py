"""A mesh file as it is: its triangles, and what colour each of them has. Nothing is mended here."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from pecgrasp_env.objects.errors import ObjectError

__all__ = ["GREY", "SUFFIXES", "Look", "Surface", "read_surface"]

SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf", ".off")
GREY = (0.35, 0.36, 0.38, 1.0)
LARGEST_TEXTURE = 1024  # pixels a side; a scan's 4096 are finer than the wrist camera sees and slow to draw
_SHADES = 32  # of red, green and blue that vertex and face colours are rounded to


@dataclass(frozen=True, eq=False)
class Look:
    """What the faces of one material look like."""

    color: tuple[float, float, float, float]  # linear RGBA in 0..1, the mean where there is a texture
    texture: np.ndarray | None = None  # (H, W, 3) uint8, sRGB, first row on top


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of a file, in its unit and axes."""

    vertices: np.ndarray  # (V, 3) float64
    faces: np.ndarray  # (F, 3) int32
    looks: tuple[Look, ...]
    look: np.ndarray  # (F,) int32, the index of each face's look
    uv: np.ndarray | None  # (F, 3, 2) float32, of the corners, where the look has a texture; else 0
    missing: tuple[str, ...] = ()  # names of material and texture files that it wants and that are not there


def read_surface(files: Sequence[tuple[Path, Sequence[float] | None]]) -> Surface:
    """The mesh of files, all their geometries together, with `.mtl` and glTF materials, textures, and vertex colours.

    files: each with the matrix (4, 4), row by row, that brings it into common axes; None: it is in them.
    Raises ObjectError where one cannot be read, has no faces, or has coordinates that are not numbers.
    """
    meshes: list[trimesh.Trimesh] = []
    missing: list[str] = []
    for file, matrix in files:
        for mesh in _geometries(file):
            meshes.append(mesh if matrix is None else mesh.apply_transform(np.reshape(matrix, (4, 4))))
        missing += _missing_files(file)
    vertices = np.concatenate([np.asarray(m.vertices, np.float64) for m in meshes])
    starts = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    faces = np.concatenate([np.asarray(m.faces, np.int32) + int(s) for m, s in zip(meshes, starts, strict=True)])
    looks: list[Look] = []
    of_face, uv = [], []
    for mesh in meshes:
        look, coordinates = _look(mesh)
        of_face.append(np.full(len(mesh.faces), len(looks), np.int32))
        looks.append(look)
        uv.append(coordinates)
    of_corners = None if all(look.texture is None for look in looks) else np.concatenate(uv)
    return Surface(vertices, faces, tuple(looks), np.concatenate(of_face), of_corners, tuple(missing))


def _geometries(file: Path) -> list[trimesh.Trimesh]:
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)  # it prints a traceback for each texture that is not there; `missing` says it
    try:
        scene = trimesh.load_scene(str(file), process=False)
        meshes = [m for m in scene.dump() if isinstance(m, trimesh.Trimesh) and len(m.faces)]
    except Exception as error:  # each format's reader has exceptions of its own
        raise ObjectError(
            f"{file} cannot be read as a mesh: {type(error).__name__}: {error}. Export it anew as .ply or .obj"
        ) from error
    finally:
        log.setLevel(level)
    if not meshes:
        raise ObjectError(
            f"{file} has no faces: a point cloud or an empty mesh is not an object. Export it with its faces, or "
            "reconstruct a surface first"
        )
    if not all(np.isfinite(mesh.vertices).all() for mesh in meshes):
        raise ObjectError(f"{file} has vertices that are not numbers. Export it anew")
    return meshes


def _look(mesh: trimesh.Trimesh) -> tuple[Look, np.ndarray]:
    """The look of a geometry, and the texture coordinates (F, 3, 2) of its corners."""
    visual, n_faces = mesh.visual, len(mesh.faces)
    none = np.broadcast_to(np.float32(0), (n_faces, 3, 2))
    if visual.kind == "vertex":
        return _painted(np.asarray(visual.vertex_colors, float)[:, :3][mesh.faces].mean(axis=1))
    if visual.kind == "face":
        return _painted(np.asarray(visual.face_colors, float)[:, :3])
    material = getattr(visual, "material", None)
    if visual.kind != "texture" or material is None:
        return Look(GREY), none
    image, factor = None, np.ones(3)
    if isinstance(material, PBRMaterial):
        image = material.baseColorTexture
        if material.baseColorFactor is not None:
            factor = np.asarray(material.baseColorFactor, float)[:3] / 255  # linear, as glTF has it
    elif isinstance(material, SimpleMaterial):
        image = material.image
        if image is None:
            factor = _linear(np.asarray(material.diffuse, float)[:3])
    uv = getattr(visual, "uv", None)
    if image is None or uv is None or len(uv) != len(mesh.vertices) or not np.isfinite(uv).all():
        return Look(_rgba(factor)), none
    texture = image.convert("RGB")
    texture.thumbnail((LARGEST_TEXTURE, LARGEST_TEXTURE))
    pixels = np.asarray(texture, np.uint8)
    if (factor < 1).any():
        pixels = np.round(255 * (_linear(pixels) * factor) ** (1 / 2.2)).astype(np.uint8)
    return Look(_rgba(_linear(pixels.reshape(-1, 3)).mean(axis=0)), pixels), np.asarray(uv, np.float32)[mesh.faces]


def _painted(colors: np.ndarray) -> tuple[Look, np.ndarray]:
    """The colours (F, 3) of faces, 0..255, as a texture that holds each shade once: SAPIEN draws no vertex colours."""
    mean = _rgba(_linear(colors).mean(axis=0))
    rounded = np.round(colors / 255 * (_SHADES - 1)).astype(np.int64)
    shades, index = np.unique(rounded @ (_SHADES**2, _SHADES, 1), return_inverse=True)
    if len(shades) == 1:
        return Look(mean), np.broadcast_to(np.float32(0), (len(colors), 3, 2))
    side = int(np.ceil(np.sqrt(len(shades))))
    total = np.zeros((side * side, 3))
    np.add.at(total, index, colors)
    counts = np.bincount(index, minlength=side * side)
    texture = np.round(total / np.maximum(counts, 1)[:, None]).astype(np.uint8).reshape(side, side, 3)
    row, column = np.divmod(index, side)
    # The middle of its pixel: there the renderer's interpolation gives the pixel itself. v counts from below.
    middle = np.stack([(column + 0.5) / side, 1 - (row + 0.5) / side], axis=1).astype(np.float32)
    return Look(mean, texture), np.repeat(middle[:, None], 3, axis=1)


def _linear(srgb: np.ndarray) -> np.ndarray:
    """Files hold sRGB in 0..255, the renderer wants linear in 0..1."""
    return (np.asarray(srgb, float) / 255) ** 2.2


def _rgba(color: np.ndarray) -> tuple[float, float, float, float]:
    red, green, blue = (float(c) for c in color)
    return red, green, blue, 1.0


def _missing_files(file: Path) -> Iterator[str]:
    """The `.mtl` files that an .obj names, and the textures that these name, as far as they are not there."""
    if file.suffix.lower() != ".obj":
        return
    with file.open("rb") as lines:
        libraries = {line[6:].strip().decode(errors="replace") for line in lines if line.startswith(b"mtllib")}
    for name in sorted(libraries):
        library = file.parent / name
        if not library.is_file():
            yield name
            continue
        for line in library.read_text(errors="replace").splitlines():
            words = line.strip().split(maxsplit=1)
            if len(words) == 2 and words[0].lower() == "map_kd":
                image = words[1].strip()
                if not (library.parent / image).is_file() and not (library.parent / image.split()[-1]).is_file():
                    yield image
