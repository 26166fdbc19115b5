"""Strangers: things on the table that are of none of the classes, from a folder of meshes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.folder_layout import MeshSource, find_classes, find_instances
from pecgrasp_env.objects.mesh_folder import load_mesh
from pecgrasp_env.objects.meshing.mesh_file import SUFFIXES
from pecgrasp_env.objects.model import ObjectModel

UNKNOWN = "unknown"  # the class name of a stranger; a classifier's word for what is of none of its classes, too


class Strangers(Protocol):
    """Where strangers come from. names: one for each of them, none twice."""

    @property
    def names(self) -> Sequence[str]: ...

    def load(self, i: int) -> ObjectModel:
        """Stranger ``i``; its class name is UNKNOWN."""
        ...


class StrangerMeshes:
    """Every mesh of a folder: those that lie in it, named by their files, or those of its subfolders, as folder/file.

    Meshes that are not closed are taken as thin shells. scale: metres in one unit of the files. Raises ObjectError: no
    such folder, or none in it; a mesh is read when it is loaded, not before.
    """

    def __init__(self, path: str | Path, scale: float = 1.0) -> None:
        folder = Path(path)
        if not folder.is_dir():
            raise ObjectError(f"strangers={str(path)!r} is not a folder")
        self.scale = scale
        self._sources: dict[str, MeshSource] = {}
        if any(file.suffix.lower() in SUFFIXES for file in folder.iterdir()):
            self._sources |= {source.name: source for source in find_instances(folder)}
        else:
            for name, inner in find_classes(folder).items():
                self._sources |= {f"{name}/{source.name}": source for source in find_instances(inner)}
        self._loaded: dict[int, ObjectModel] = {}

    @property
    def names(self) -> list[str]:
        return list(self._sources)

    def load(self, i: int) -> ObjectModel:
        """Raises ObjectError as `load_mesh` does."""
        if i not in self._loaded:
            name, source = list(self._sources.items())[i]
            renamed = MeshSource(name, source.files)
            self._loaded[i] = load_mesh(renamed, UNKNOWN, self.scale, allow_open=True)
        return self._loaded[i]
