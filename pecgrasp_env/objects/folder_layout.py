"""Where the meshes lie in folders of other people: our own layout, YCB's, ShapeNet's, and packs of URDFs.

    FOLDER/<class>/<instance>.obj                                       ours
    FOLDER/<class>/<object>/…   FOLDER/<object>/…                       an object in a folder of its own, such as
        google_16k/{textured.obj, nontextured.ply}, poisson/, tsdf/     YCB
        models/model_normalized.obj                                     ShapeNet
        <object>.urdf, meshes/{visual.obj, collision.obj}               URDF

Of an object's meshes one is taken; those made for collisions are none.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from trimesh.transformations import euler_matrix

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.meshing.mesh_file import SUFFIXES

__all__ = ["MeshSource", "find_classes", "find_instances", "mesh_of_object"]

# Folders inside an object's folder, those that are preferred first.
_INNER = (
    "google_16k",
    "models",
    "model",
    "meshes",
    "mesh",
    "visual",
    "visuals",
    "google_64k",
    "google_512k",
    "poisson",
    "tsdf",
    "textured",
    "obj",
    "textured_objs",
    "collision",
    "collisions",
)
# Names that say nothing of the object, those that are preferred first: several of them are one thing in many forms.
_FORMS = ("textured", "model_normalized", "visual", "model", "mesh", "textured_simple", "nontextured", "base", "object")
_FOR_PHYSICS = re.compile(r"(^|[^a-z])(collision|collisions|collider|vhacd|v_hacd|convex|coacd|decomp\w*)([^a-z]|$)")
_UNREAD = (".dae", ".fbx", ".blend", ".3ds", ".usd", ".usda", ".usdc", ".usdz", ".step", ".stp", ".iges", ".wrl")


@dataclass(frozen=True)
class MeshSource:
    """The mesh of an instance: files, each with the matrix (4, 4), row by row, that puts it into the object's axes."""

    name: str
    files: tuple[tuple[Path, tuple[float, ...] | None], ...]

    @property
    def file(self) -> Path:
        """The file that messages name."""
        return self.files[0][0]


def find_classes(root: Path) -> dict[str, Path]:
    """The folders of the classes by name. Raises ObjectError, with the way out, where there are none."""
    folders = _subfolders(root)
    with_meshes = [name for name in folders if next(_below(folders[name]), None)]
    wanted = f"expected class_name/instance{{{','.join(SUFFIXES)}}}"
    if _urdf(root) or (with_meshes and all(name.lower() in _INNER for name in with_meshes)):
        inner = next((folders[n] for n in with_meshes if _subfolders(folders[n])), None)
        if not _urdf(root) and inner is not None:
            raise ObjectError(f"{root} has no classes, but {inner} may: give objects.path={shlex.quote(str(inner))}")
        raise ObjectError(
            f"{root} is one object, not a folder of classes. Give the folder above, and its name as the class: "
            f"objects.path={shlex.quote(str(root.resolve().parent))} 'objects.classes=[{root.resolve().name}]'"
        )
    loose = _meshes(root)
    if loose and not with_meshes:
        suffix = loose[0].suffix
        raise ObjectError(
            f"{root} has no classes: {wanted}, and {len(loose)} meshes lie in it directly, {loose[0].name} the first. "
            "A class for each of them:\n"
            f'  cd {shlex.quote(str(root))} && for f in *{suffix}; do mkdir -p "classes/${{f%.*}}" && '
            'cp "${f%.*}".* "classes/${f%.*}/"; done\n'
            f"then objects.path={shlex.quote(str(root / 'classes'))}; or all in one class, with its name for CLASS: "
            f"mkdir classes && ln -s .. classes/CLASS"
        )
    if not folders:
        raise ObjectError(f"{root} has no classes: {wanted}")
    return folders


def find_instances(folder: Path) -> list[MeshSource]:
    """The instances of a class, in alphabetical order. Raises ObjectError where there is none, or what lies there
    could be read in several ways; the message has the command that lays it out.
    """
    inside = _subfolders(folder)
    direct = _meshes(folder)
    named = [file for file in direct if file.stem.lower() not in _FORMS]
    inner = [p for name, p in inside.items() if name.lower() in _INNER and next(_below(p), None)]
    if _urdf(folder) or (not named and (inner or len(direct) > 1)):
        return [mesh_of_object(folder)]
    found = [MeshSource(file.stem, ((file, None),)) for file in direct]
    for name, sub in inside.items():
        if name.lower() not in _INNER and (_urdf(sub) or next(_below(sub), None)):
            found.append(mesh_of_object(sub))
    if not found:
        raise ObjectError(f"{folder} has no mesh ({', '.join(SUFFIXES)}){_what_else(folder)}")
    found.sort(key=lambda instance: (instance.name, instance.file))
    for a, b in pairwise(found):
        if a.name == b.name:
            raise ObjectError(
                f"{a.file} and {b.file} have one name: instances are told apart by it, rename or remove one"
            )
    return found


def mesh_of_object(folder: Path) -> MeshSource:
    """The mesh of the object that has this folder for itself. Raises ObjectError where it cannot be told."""
    if urdf := _urdf(folder):
        return MeshSource(folder.name, _visuals(urdf))
    files = sorted(_below(folder))
    if not files:
        raise ObjectError(f"{folder} has no mesh ({', '.join(SUFFIXES)}){_what_else(folder)}")
    best = min(files, key=lambda file: _rank(file, folder))
    rivals = [file for file in files if _rank(file, folder)[:2] == _rank(best, folder)[:2] and file.stem != best.stem]
    if rivals:
        raise ObjectError(
            f"{folder} lies where an object is expected and holds several meshes, {best.name} and {rivals[0].name} "
            f"among them. Where each is an instance of class {best.parent.name}, lay out the classes side by side:\n"
            f"  mkdir LAID_OUT && cp -r {shlex.quote(str(best.parent.parent))}/* LAID_OUT/\n"
            "then objects.path=LAID_OUT. Where they are pieces of one object, join them to one file (Blender, MeshLab)"
        )
    return MeshSource(folder.name, ((best, None),))


def _subfolders(folder: Path) -> dict[str, Path]:
    """The folders in a folder by name, but for hidden ones and those made for collisions."""
    return {
        p.name: p
        for p in sorted(folder.iterdir())
        if p.is_dir() and not p.name.startswith(".") and not _FOR_PHYSICS.search(p.name.lower())
    }


def _meshes(folder: Path) -> list[Path]:
    """The meshes that lie in a folder itself, but for those made for collisions."""
    return sorted(
        f
        for f in folder.iterdir()
        if f.suffix.lower() in SUFFIXES and not f.name.startswith(".") and not _FOR_PHYSICS.search(f.stem.lower())
    )


def _below(folder: Path) -> Iterator[Path]:
    """The meshes in a folder and in those below it, but for those made for collisions."""
    yield from _meshes(folder)
    for sub in _subfolders(folder).values():
        yield from _below(sub)


def _rank(file: Path, folder: Path) -> tuple[int, int, int]:
    """The less the likelier the file is the object as it looks, at a moderate number of faces."""
    parents = [p.lower() for p in file.relative_to(folder).parts[:-1]]
    inner = min((_INNER.index(p) for p in parents if p in _INNER), default=-1 if not parents else len(_INNER))
    stem = file.stem.lower()
    if stem == folder.name.lower():
        form = 0
    else:
        form = next((i for i, name in enumerate(_FORMS, 1) if stem == name), len(_FORMS) + 1)
    if form > len(_FORMS) and "visual" in stem:
        form = len(_FORMS)
    return inner, form, SUFFIXES.index(file.suffix.lower())


def _what_else(folder: Path) -> str:
    """What lies there instead of a mesh, and what to do about it."""
    others = [f for f in sorted(folder.rglob("*")) if f.is_file()]
    for file in others:
        if file.suffix.lower() in SUFFIXES:
            return f": {file.name} is made for collisions. Put the mesh that is seen beside it, or rename it"
    for file in others:
        if file.suffix.lower() in _UNREAD:
            return f": {file.name} is in a format that is not read. Export it as .glb or .obj"
    return ". Leave it out with objects.classes=[…]" if others else ""


def _urdf(folder: Path) -> Path | None:
    """The URDF of the object that has this folder for itself."""
    files = sorted(folder.glob("*.urdf"))
    return next((f for f in files if f.stem == folder.name), files[0] if files else None)


def _visuals(urdf: Path) -> tuple[tuple[Path, tuple[float, ...] | None], ...]:
    """The meshes that an URDF shows, with their scale and place."""
    try:
        robot = ET.parse(urdf).getroot()
    except ET.ParseError as error:
        raise ObjectError(f"{urdf} cannot be read as an URDF: {error}") from error
    links = [link for link in robot.iter("link") if link.find("visual/geometry/mesh") is not None]
    if not links:
        raise ObjectError(
            f"{urdf} shows no mesh, only shapes of its own or nothing. Put the object's mesh into "
            f"{urdf.parent.parent}/{urdf.parent.name}.obj and remove {urdf.parent}"
        )
    if len(links) > 1:
        raise ObjectError(
            f"{urdf} has {len(links)} links with meshes: things with joints are not taken. Export it as one mesh "
            "(Blender, or `python -m trimesh`), or leave it out with objects.classes=[…]"
        )
    files = []
    for visual in links[0].iter("visual"):
        mesh = visual.find("geometry/mesh")
        if mesh is None:
            continue
        named = mesh.get("filename", "")
        file = _resolved(urdf, named)
        if file is None or file.suffix.lower() not in SUFFIXES:
            why = "is not there" if file is None else "is in a format that is not read: export it as .glb or .obj"
            raise ObjectError(f"{urdf} shows {named}, which {why}")
        matrix = np.eye(4)
        origin = visual.find("origin")
        if origin is not None:
            matrix = euler_matrix(*_numbers(urdf, origin, "rpy", "0 0 0"))
            matrix[:3, 3] = _numbers(urdf, origin, "xyz", "0 0 0")
        scale = _numbers(urdf, mesh, "scale", "1 1 1")
        matrix = matrix @ np.diag([*scale, 1.0])
        files.append((file, None if np.array_equal(matrix, np.eye(4)) else tuple(matrix.reshape(-1).tolist())))
    return tuple(files)


def _resolved(urdf: Path, named: str) -> Path | None:
    """The file that an URDF names: beside it, or in a package whose folder is above it."""
    relative = Path(re.sub(r"^(package|model|file)://", "", named))
    parts = [relative, *(Path(*relative.parts[i:]) for i in range(1, len(relative.parts)))]
    bases = [urdf.parent, *list(urdf.parents)[1:4]]
    return next((base / part for base in bases for part in parts if (base / part).is_file()), None)


def _numbers(urdf: Path, element: ET.Element, name: str, default: str) -> list[float]:
    words = element.get(name, default).split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise ObjectError(f"{urdf}: {name}={element.get(name)!r} of {element.tag} should be three numbers")
    return numbers
