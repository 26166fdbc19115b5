"""Objects to grasp: a procedural catalogue, folders of one's own meshes, and strangers to the classes of either."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.mesh_folder import MeshFolder
from pecgrasp_env.objects.meshing.mesh_cache import Part
from pecgrasp_env.objects.model import ObjectModel
from pecgrasp_env.objects.procedural.catalogue import CLASSES, LARS_CLASSES, Catalogue, make_object
from pecgrasp_env.objects.procedural.strangers.draw import DrawnStrangers, stranger, strangers_for
from pecgrasp_env.objects.strangers import UNKNOWN

__all__ = [
    "CLASSES",
    "LARS_CLASSES",
    "UNKNOWN",
    "Catalogue",
    "DrawnStrangers",
    "MeshFolder",
    "ObjectError",
    "ObjectModel",
    "Part",
    "make_object",
    "open_objects",
    "stranger",
    "strangers_for",
]


def open_objects(
    path: str | Path | None = None,
    classes: Sequence[str] | None = None,
    instances_per_class: int = 10,
    seed: int = 0,
    scale: float = 1.0,
    allow_open: bool = False,
) -> Catalogue | MeshFolder:
    """The mesh folder at `path`, or without one the procedural catalogue; `classes` narrows either down.

    instances_per_class and seed concern the catalogue; scale (metres in one unit of the files) and allow_open (take
    meshes that are not closed) the folder.
    Raises ObjectError as Catalogue and MeshFolder do.
    """
    if path is not None:
        return MeshFolder(path, scale=scale, classes=classes, allow_open=allow_open)
    return Catalogue(CLASSES if classes is None else classes, instances_per_class, seed)
