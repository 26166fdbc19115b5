"""A folder of one's own meshes: class_name/instance.{obj,ply,stl,glb,…}, cut into convex parts once and remembered."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

import numpy as np

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.folder_layout import MeshSource, find_classes, find_instances
from pecgrasp_env.objects.meshing.convex_cache import convex_parts
from pecgrasp_env.objects.meshing.convex_hulls import hull_volume
from pecgrasp_env.objects.meshing.mend import Body, mend
from pecgrasp_env.objects.meshing.mesh_cache import Part
from pecgrasp_env.objects.meshing.mesh_file import Surface, read_surface
from pecgrasp_env.objects.meshing.volume import solid_volume
from pecgrasp_env.objects.model import LIGHTEST, ObjectModel, centre_of_mass

SMALLEST, LARGEST = 0.005, 2.0  # m, the longest side that an object may have
DENSITY = 500.0  # kg/m³ of what the mesh encloses: a household thing, part plastic, part air
HEAVIEST = 1.5  # kg, so that what is dense in fact or hollow in the mesh can still be lifted


class MeshWarning(UserWarning):
    """What was mended in a mesh, or is missing beside it."""


class MeshFolder:
    """The classes are the folder's subfolders, the instances the meshes in them, both in alphabetical order.

    A mesh may lie in a folder of its own, as YCB, ShapeNet and packs of URDFs have them (`folder_layout`); what is made
    for collisions is passed over, as are hidden folders and other files. scale: metres in one unit of the files (0.001
    for millimetres). classes: only these subfolders. allow_open: take meshes that are not closed, as thin shells. The
    object frame has the axes of the file (z is taken to be up) and its origin at the hulls' centre of mass.
    Raises ObjectError: no such folder, no classes in it, a class without meshes, two meshes of one name, a scale that
    is not positive. A mesh is read when it is loaded, not before; what was mended in it is a MeshWarning.
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
        folders = find_classes(self.path)
        for name in classes or ():
            if name not in folders:
                raise ObjectError(f"unknown object class {name!r}; {self.path} has {', '.join(folders)}")
        self.classes = tuple(classes) if classes else tuple(folders)
        self._sources = {name: find_instances(folders[name]) for name in self.classes}
        self.allow_open = allow_open
        self._loaded: dict[tuple[str, int], ObjectModel] = {}

    def names(self, class_name: str) -> list[str]:
        """The names of the class's instances, in order."""
        return [source.name for source in self._of(class_name)]

    def load(self, class_name: str, i: int) -> ObjectModel:
        """Instance `i` of a class. Raises ObjectError for an unknown class or instance, and as `load_mesh` does."""
        sources = self._of(class_name)
        if not 0 <= i < len(sources):
            raise ObjectError(f"{class_name} has instances 0 to {len(sources) - 1}, asked for {i}")
        if (class_name, i) not in self._loaded:
            self._loaded[class_name, i] = load_mesh(sources[i], class_name, self.scale, self.allow_open)
        return self._loaded[class_name, i]

    def file_origin(self, class_name: str, i: int) -> np.ndarray:
        """Where the origin of instance `i`'s file lies in its object frame, (3,) m; raises as `load` does."""
        model = self.load(class_name, i)
        surface = read_surface(self._of(class_name)[i].files)
        # By their lowest corners: the vertices themselves are others where the mesh was mended.
        lowest = surface.vertices[np.unique(surface.faces)].min(axis=0) * self.scale
        return np.concatenate([part.vertices for part in model.parts]).min(axis=0) - lowest

    def origin(self, class_name: str, i: int) -> str:
        """Where instance `i` comes from, in words."""
        file = self._of(class_name)[i].file
        return f"mesh {file.name}"

    def prepare(
        self,
        wanted: Iterable[tuple[str, int]] | None = None,
        at_once: int = 2,
        progress: Callable[[int, int], None] | None = None,
    ) -> dict[tuple[str, int], ObjectError]:
        """Cut instances (class, number) into convex parts ahead of their use, several at once; None: all of them.

        progress(done, total), in meshes, is called at the start and after each. Returns the errors of those that cannot
        be used. Nothing is kept in memory.
        """
        todo = [(c, i) for c in self.classes for i in range(len(self._of(c)))] if wanted is None else list(wanted)
        errors: dict[tuple[str, int], ObjectError] = {}

        def cut(one: tuple[str, int]) -> None:
            try:
                _physical(self._of(one[0])[one[1]], self.scale, self.allow_open)
            except ObjectError as error:
                errors[one] = error

        if progress:
            progress(0, len(todo))
        # CoACD runs in processes of its own, so threads are enough.
        with ThreadPoolExecutor(max(1, at_once)) as pool:
            for done, finished in enumerate(as_completed([pool.submit(cut, one) for one in todo]), 1):
                finished.result()
                if progress:
                    progress(done, len(todo))
        return {one: errors[one] for one in todo if one in errors}

    def _of(self, class_name: str) -> list[MeshSource]:
        if class_name not in self._sources:
            raise ObjectError(f"unknown object class {class_name!r}; {self.path} has {', '.join(self.classes)}")
        return self._sources[class_name]


def load_mesh(source: MeshSource, class_name: str, scale: float = 1.0, allow_open: bool = False) -> ObjectModel:
    """The object of a mesh. The first time it takes CoACD seconds; then the convex parts come from the cache.

    Raises ObjectError where it cannot be read, has no faces or no volume, is not closed (but for allow_open), or has a
    size that no object for a gripper has; the message names the file and says what to do.
    """
    surface, body, hulls = _physical(source, scale, allow_open)
    notes = list(body.notes)
    if surface.missing:
        notes.append(f"{', '.join(surface.missing)} is not there, so its colours are not known")
    if notes:
        warnings.warn(f"{source.file}: {'; '.join(notes)}", MeshWarning, stacklevel=3)
    centre = centre_of_mass(hulls)
    if body.open_edges:
        volume = sum(hull_volume(h) for h in hulls)
    else:
        volume = solid_volume(body.vertices, body.faces) * scale**3
    mass = float(np.clip(DENSITY * volume, LIGHTEST, HEAVIEST))
    centred = tuple((h - centre).astype(np.float32) for h in hulls)
    parts = _parts(surface, body, scale, centre)
    return ObjectModel(class_name, source.name, parts, centred, mass, tuple(notes))


def _physical(source: MeshSource, scale: float, allow_open: bool) -> tuple[Surface, Body, list[np.ndarray]]:
    """The mesh as its files have it, what is mended of it, and its convex parts in metres."""
    surface = read_surface(source.files)
    _check_size(source.file, surface, scale)
    body = mend(surface.vertices, surface.faces, str(source.file))
    if body.open_edges and not (allow_open or body.is_sheet):
        raise ObjectError(
            f"{source.file} is not closed: {body.open_edges} of its edges border on one face only, so it has no "
            "inside. Close its holes (MeshLab: Close Holes; Blender: Fill Holes), or take it as it is with "
            "objects.allow_open=true"
        )
    hulls = [np.asarray(h, np.float64) * scale for h in convex_parts(body.vertices, body.faces)]
    if not hulls:
        raise ObjectError(
            f"{source.file} encloses no volume: no convex part was found in it. Is it a sheet without a back?"
        )
    return surface, body, hulls


def _parts(surface: Surface, body: Body, scale: float, centre: np.ndarray) -> tuple[Part, ...]:
    """What is seen, a part for each look."""
    parts = []
    look_of = surface.look[body.of_file]
    for number, look in enumerate(surface.looks):
        chosen = look_of == number
        if not chosen.any():
            continue
        used, faces = np.unique(body.drawn[chosen], return_inverse=True)
        vertices = (body.vertices[used] * scale - centre).astype(np.float32)
        uv = None
        if look.texture is not None and surface.uv is not None:
            uv = surface.uv[body.of_file[chosen]]
            turned = body.turned[chosen]
            uv[turned] = uv[turned, ::-1]
        parts.append(Part(vertices, faces.reshape(-1, 3).astype(np.int32), look.color, look.texture, uv))
    return tuple(parts)


def _check_size(file: Path, surface: Surface, scale: float) -> None:
    sides = np.ptp(surface.vertices[np.unique(surface.faces)], axis=0) * scale
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
