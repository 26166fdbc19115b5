"""The official archive of ModelNet10, as it is downloaded or unpacked: meshes without unit, in .off files.

Wu et al., "3D ShapeNets: a deep representation for volumetric shapes", CVPR 2015. In the archive lies
ModelNet10/<class>/{train,test}/<instance>.off.
"""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.meshing.mesh_cache import Part
from pecgrasp_env.objects.model import ObjectModel

__all__ = ["ModelNetArchive", "read_off"]

_GREY = (0.35, 0.36, 0.38, 1.0)


class ModelNetArchive:
    """The meshes of ModelNet10.zip, or of the folder that was unpacked from it; of another such set, too.

    Instances of a class are those of its train folder, then those of its test folder, in alphabetical order.
    Raises ObjectError: no such file or folder, no .off file in it, an unknown class.
    """

    def __init__(self, path: str | Path, classes: Sequence[str] | None = None) -> None:
        self.path = Path(path)
        self._zip: zipfile.ZipFile | None = None
        files: dict[str, dict[str, list[str]]] = {}
        for name in sorted(self._files()):
            *_, class_name, part, _ = name.split("/")
            if part in ("train", "test"):
                files.setdefault(class_name, {"train": [], "test": []})[part].append(name)
        if not files:
            raise ObjectError(f"objects.path={str(path)!r} holds no ModelNet10/<class>/{{train,test}}/<name>.off")
        for name in classes or ():
            if name not in files:
                raise ObjectError(f"unknown object class {name!r}; {self.path} has {', '.join(files)}")
        self.classes = tuple(classes) if classes else tuple(files)
        self._of_class = {name: files[name]["train"] + files[name]["test"] for name in self.classes}
        self._n_train = {name: len(files[name]["train"]) for name in self.classes}

    def names(self, class_name: str) -> list[str]:
        """The names of the class's instances, in order."""
        return [Path(file).stem for file in self._of_class[class_name]]

    def load(self, class_name: str, i: int) -> ObjectModel:
        """Instance `i` of a class: its surface in the file's unit, no hulls. Raises ObjectError for a broken file."""
        file = self._of_class[class_name][i]
        try:
            vertices, faces = read_off(self._read(file))
        except (ValueError, IndexError, KeyError, zipfile.BadZipFile) as error:
            raise ObjectError(f"{self.path}: {file} is not a readable .off mesh: {error}") from error
        part = Part(vertices.astype(np.float32), faces.astype(np.int32), _GREY)
        return ObjectModel(class_name, Path(file).stem, (part,), (), 0.0)

    def origin(self, class_name: str, i: int) -> str:
        """Where instance `i` comes from, in words."""
        return f"ModelNet {self.split(class_name, i)}"

    def split(self, class_name: str, i: int) -> str:
        """The official split that instance `i` belongs to: "train" or "test"."""
        return "train" if i < self._n_train[class_name] else "test"

    def _files(self) -> list[str]:
        if self.path.is_dir():
            return [file.relative_to(self.path).as_posix() for file in self.path.glob("**/*/*/*.off")]
        try:
            with zipfile.ZipFile(self.path) as archive:
                return [
                    n for n in archive.namelist() if n.endswith(".off") and "__MACOSX" not in n and n.count("/") > 1
                ]
        except (OSError, zipfile.BadZipFile) as error:
            raise ObjectError(
                f"objects.path={str(self.path)!r} is neither a folder nor a readable archive ({error}). ModelNet10.zip "
                "comes from https://modelnet.cs.princeton.edu"
            ) from error

    def _read(self, file: str) -> bytes:
        if self.path.is_dir():
            return (self.path / file).read_bytes()
        if self._zip is None:
            self._zip = zipfile.ZipFile(self.path)
        return self._zip.read(file)


def read_off(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) float64 and triangles (F, 3) int64 of an .off file; polygons become fans.

    In some of ModelNet's files the counts follow "OFF" without a line break. Raises ValueError for other files.
    """
    if data[:3] != b"OFF":
        raise ValueError("it does not begin with OFF")
    words = data[3:].split()
    n_vertices, n_faces = int(words[0]), int(words[1])
    begin = 3 + 3 * n_vertices
    numbers = np.array(words[3:begin], np.float64)
    if len(numbers) != 3 * n_vertices or not n_vertices:
        raise ValueError(f"it promises {n_vertices} vertices and holds {len(numbers) // 3}")
    rest = np.array(words[begin:], np.float64).astype(np.int64)
    if len(rest) >= 4 * n_faces and n_faces and (rest[: 4 * n_faces : 4] == 3).all():
        faces = rest[: 4 * n_faces].reshape(-1, 4)[:, 1:]
    else:
        triangles, at = [], 0
        for _ in range(n_faces):
            corners = rest[at + 1 : at + 1 + rest[at]]
            triangles += [(corners[0], corners[k], corners[k + 1]) for k in range(1, len(corners) - 1)]
            at += 1 + int(rest[at])
        faces = np.array(triangles, np.int64).reshape(-1, 3)
    if not len(faces):
        raise ValueError("it has no faces")
    if faces.min() < 0 or faces.max() >= n_vertices or not np.isfinite(numbers).all():
        raise ValueError("a face has a corner that does not exist, or a vertex is not a number")
    return numbers.reshape(-1, 3), faces
