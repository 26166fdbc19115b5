"""A folder of one's own meshes: class_name/instance.{obj,ply,stl,glb}, cut into convex parts once and remembered."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Sequence
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

import numpy as np
import trimesh

from pec.common.atomic_files import write_whole
from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.meshing.convex_decomposition import COACD, MOST_FACES, decompose, edge_counts
from pecgrasp_env.objects.meshing.convex_hulls import hull_volume
from pecgrasp_env.objects.meshing.mesh_cache import Part, cache_folder
from pecgrasp_env.objects.model import ObjectModel, centre_of_mass

SUFFIXES = (".obj", ".ply", ".stl", ".glb")
SMALLEST, LARGEST = 0.005, 2.0  # m, the longest side that an object may have
DENSITY = 500.0  # kg/m³ of the hulls: a household thing, part plastic, part air
HEAVIEST = 1.5  # kg, so that what is dense in fact or hollow in the mesh can still be lifted
GREY = (0.35, 0.36, 0.38, 1.0)


class MeshFolder:
    """The classes are the folder's subfolders, the instances the meshes in them, both in alphabetical order.

    scale: metres in one unit of the files (0.001 for millimetres). classes: only these subfolders. allow_open: take
    meshes that are not closed, as thin shells. The object frame has the axes of the file (z is taken to be up) and its
    origin at the hulls' centre of mass. Hidden folders and other files are passed over.
    Raises ObjectError: no such folder, no classes in it, a class without meshes, two meshes of one name, a scale that
    is not positive. A mesh is read when it is loaded, not before.
    """

    def __init__(
        self, path: str | Path, scale: float = 1.0, classes: Sequence[str] | None = None, allow_open: bool = False
    ) -> None:
        self.path = Path(path)
        self.scale = float(scale)
        if not self.path.is_dir():
            raise ObjectError(f"objects.path={str(path)!r} is not a folder")
        if not (np.isfinite(self.scale) and self.scale > 0):
            raise ObjectError(f"objects.scale must be positive, got {scale}")
        folders = {p.name: p for p in sorted(self.path.iterdir()) if p.is_dir() and not p.name.startswith(".")}
        if not folders:
            raise ObjectError(f"{self.path} has no classes: expected class_name/instance{{{','.join(SUFFIXES)}}}")
        for name in classes or ():
            if name not in folders:
                raise ObjectError(f"unknown object class {name!r}; {self.path} has {', '.join(folders)}")
        self.classes = tuple(classes) if classes else tuple(folders)
        self._files = {name: _meshes_in(folders[name]) for name in self.classes}
        self.allow_open = allow_open
        self._loaded: dict[Path, ObjectModel] = {}

    def names(self, class_name: str) -> list[str]:
        """The names of the class's instances, in order."""
        return [f.stem for f in self._of(class_name)]

    def load(self, class_name: str, i: int) -> ObjectModel:
        """Instance `i` of a class. Raises ObjectError for an unknown class or instance, and as `load_mesh` does."""
        files = self._of(class_name)
        if not 0 <= i < len(files):
            raise ObjectError(f"{class_name} has instances 0 to {len(files) - 1}, asked for {i}")
        file = files[i]
        if file not in self._loaded:
            self._loaded[file] = load_mesh(file, class_name, file.stem, self.scale, self.allow_open)
        return self._loaded[file]

    def origin(self, class_name: str, i: int) -> str:
        """Where instance `i` comes from, in words."""
        return f"mesh {self._of(class_name)[i].name}"

    def _of(self, class_name: str) -> list[Path]:
        if class_name not in self._files:
            raise ObjectError(f"unknown object class {class_name!r}; {self.path} has {', '.join(self.classes)}")
        return self._files[class_name]


def _meshes_in(folder: Path) -> list[Path]:
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith("."))
    if not files:
        raise ObjectError(f"{folder} has no mesh ({', '.join(SUFFIXES)})")
    for a, b in pairwise(files):
        if a.stem == b.stem:
            raise ObjectError(f"{a} and {b} have one name: instances are told apart by it, rename one")
    return files


def load_mesh(file: Path, class_name: str, name: str, scale: float = 1.0, allow_open: bool = False) -> ObjectModel:
    """The object of one mesh file. The first time it takes CoACD seconds; then the convex parts come from the cache.

    Raises ObjectError where it cannot be read, has no faces or no volume, is not closed (but for allow_open), or has a
    size that no object for a gripper has; the message names the file and says what to do.
    """
    mesh = _read(file)
    _check_size(file, mesh, scale)
    borders = _borders(mesh)
    if borders and not allow_open:
        raise ObjectError(
            f"{file} is not closed: {borders} of its edges border on one face only, so it has no inside. Close its "
            "holes (MeshLab: Close Holes; Blender: Fill Holes), or take it as it is with objects.allow_open=true"
        )
    hulls = [np.asarray(h, np.float64) * scale for h in convex_parts(mesh)]
    if not hulls:
        raise ObjectError(f"{file} encloses no volume: no convex part was found in it. Is it a sheet without a back?")
    centre = centre_of_mass(hulls)
    mass = float(np.clip(DENSITY * sum(hull_volume(h) for h in hulls), 0.02, HEAVIEST))
    vertices = (np.asarray(mesh.vertices) * scale - centre).astype(np.float32)
    part = Part(vertices, np.asarray(mesh.faces, np.int32), _color(mesh))
    return ObjectModel(class_name, name, (part,), tuple((h - centre).astype(np.float32) for h in hulls), mass)


def _read(file: Path) -> trimesh.Trimesh:
    try:
        mesh = trimesh.load(str(file), force="mesh", process=False)
    except Exception as error:  # each format's reader has exceptions of its own
        raise ObjectError(
            f"{file} cannot be read as a mesh: {type(error).__name__}: {error}. Export it anew as .ply or .obj"
        ) from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise ObjectError(
            f"{file} has no faces: a point cloud or an empty mesh is not an object. Export it with its faces, or "
            "reconstruct a surface first"
        )
    if not np.isfinite(mesh.vertices).all():
        raise ObjectError(f"{file} has vertices that are not numbers. Export it anew")
    mesh.merge_vertices()
    mesh.fill_holes()  # a missing triangle would make CoACD take a solid for a hollow shell
    return mesh


def _borders(mesh: trimesh.Trimesh) -> int:
    """How many edges belong to an odd number of faces: of a closed surface none does, wherever it touches itself."""
    return int((edge_counts(np.asarray(mesh.faces)) % 2).sum())


def _color(mesh: trimesh.Trimesh) -> tuple[float, float, float, float]:
    """The mean of the mesh's own colours, or grey."""
    if mesh.visual.kind == "vertex":
        mean = np.asarray(mesh.visual.vertex_colors, float).mean(axis=0) / 255
    elif mesh.visual.kind == "face":
        mean = np.asarray(mesh.visual.face_colors, float).mean(axis=0) / 255
    else:
        return GREY
    red, green, blue = (float(c) for c in mean[:3] ** 2.2)  # files hold sRGB, the renderer wants linear
    return red, green, blue, 1.0


def _check_size(file: Path, mesh: trimesh.Trimesh, scale: float) -> None:
    sides = np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0) * scale
    longest = float(sides.max())
    if sides.min() < 1e-4 * longest:
        raise ObjectError(f"{file} is a flat sheet: it encloses no volume. Give it a thickness")
    if SMALLEST <= longest <= LARGEST:
        return
    message = f"{file} is {longest:.4g} m long, outside {SMALLEST} to {LARGEST} m"
    for factor, unit in ((1e-3, "millimetres"), (1e-2, "centimetres")):
        if SMALLEST <= longest * factor <= LARGEST:
            raise ObjectError(f"{message}. If its unit is {unit}, set objects.scale={scale * factor:g}")
    raise ObjectError(f"{message}. objects.scale is {scale:g}: metres in one unit of the file")


def convex_parts(mesh: trimesh.Trimesh) -> list[np.ndarray]:
    """Convex parts of a mesh, (K, 3) each, in its unit, found once and kept in the cache folder.

    The file is named by the hash of the mesh, of the way of finding them and of CoACD's version.
    """
    vertices = np.ascontiguousarray(mesh.vertices, np.float64)
    faces = np.ascontiguousarray(mesh.faces, np.int32)
    digest = hashlib.sha256(vertices.tobytes() + faces.tobytes())
    digest.update(f"{sorted(COACD.items())} {MOST_FACES} coacd {version('coacd')}".encode())
    path = cache_folder() / f"{digest.hexdigest()[:32]}.coacd.npz"
    if not path.exists():
        parts = decompose(vertices, faces)
        buffer = io.BytesIO()
        counts = np.array([len(p) for p in parts], np.int64)
        np.savez(buffer, points=np.concatenate([*parts, np.empty((0, 3))]), counts=counts)
        write_whole(path, buffer.getvalue())
    with np.load(path, allow_pickle=False) as stored:
        return np.split(stored["points"], np.cumsum(stored["counts"])[:-1]) if len(stored["counts"]) else []
