"""The models whose poses are regressed: points of their surfaces and the motions that leave them as they are.

One safetensors file, written by whoever has the meshes (`pecgrasp train-pose` lets the generator of the clouds do it):

    points             (C, P, 3) float32   of each model's whole surface, in its own frame, metres
    origins            (C, 3) float32      of the models' frames, in those that the clouds' poses are of, metres
    symmetries         (S, 4, 4) float32   of all models one after the other: what maps the model onto itself
    symmetry_offsets   (C + 1,) int64      model i has symmetries[offsets[i]:offsets[i + 1]], the first is the identity
    metadata           names: JSON list of the models' names, "class/instance"

A continuous symmetry, as that of a can about its axis, is a row of small turns. A generated data set has objects' poses
with the origin at their centre of mass; a model is usually wanted in the frame of its mesh file: `origins` says how far
the two are apart (their axes are the same).
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from pec.common.atomic_files import write_whole
from pec.errors import ModelsError

__all__ = ["PoseModels", "read_models", "write_models"]

_DTYPES = {"points": np.float32, "origins": np.float32, "symmetries": np.float32, "symmetry_offsets": np.int64}


@dataclass(frozen=True, eq=False)
class PoseModels:
    """names: C different ones. points: (C, P, 3) float32, model frame, metres. symmetries: for each model (S_i, 4, 4)
    float32, the identity first. origins: (C, 3) float32, of the models' frames in those that clouds' poses are of.

    Raises ModelsError, which names the model, where they do not fit each other or are no points of a solid thing in
    metres.
    """

    names: tuple[str, ...]
    points: np.ndarray
    symmetries: tuple[np.ndarray, ...]
    origins: np.ndarray

    def __post_init__(self) -> None:
        n = len(self.names)
        if n == 0 or len(set(self.names)) != n:
            raise ModelsError(f"models need names, one at least and none twice; got {list(self.names)}")
        if self.points.ndim != 3 or self.points.shape[::2] != (n, 3) or self.points.shape[1] < 4:
            raise ModelsError(f"points of {n} models must be ({n}, P ≥ 4, 3), got {self.points.shape}")
        if self.origins.shape != (n, 3) or not np.isfinite(self.origins).all():
            raise ModelsError(f"origins of {n} models must be finite ({n}, 3), got {self.origins.shape}")
        if len(self.symmetries) != n:
            raise ModelsError(f"{n} models, but the symmetries of {len(self.symmetries)}")
        for name, points, symmetries in zip(self.names, self.points, self.symmetries, strict=True):
            _check(name, points, symmetries)

    @cached_property
    def centres(self) -> np.ndarray:
        """(C, 3) float64 the mean of each model's points, model frame, metres."""
        return self.points.mean(axis=1, dtype=np.float64)

    @cached_property
    def moments(self) -> np.ndarray:
        """(C, 3, 3) float64 second moments about the centres, m²."""
        centred = self.points - self.centres[:, None]
        return np.einsum("cpi,cpj->cij", centred, centred) / self.points.shape[1]

    @cached_property
    def radii(self) -> np.ndarray:
        """(C,) float64 root mean square distances from the centres, m."""
        return np.sqrt(np.trace(self.moments, axis1=1, axis2=2))

    @cached_property
    def diameters(self) -> np.ndarray:
        """(C,) float64 greatest distance of two points, m."""
        return np.array([_diameter(points) for points in self.points])

    @cached_property
    def version(self) -> str:
        """16 hexadecimal digits that differ where the models do."""
        content = [self.points, self.origins, *self.symmetries]
        digest = hashlib.sha256(json.dumps(self.names).encode())
        for array in content:
            digest.update(np.ascontiguousarray(array, np.float32).tobytes())
        return digest.hexdigest()[:16]

    def index(self, name: str) -> int:
        """The place of a model. Raises ModelsError where it is none of these."""
        if name not in self.names:
            raise ModelsError(f"no model is called {name!r}; there are {', '.join(self.names)}")
        return self.names.index(name)


def write_models(path: str | os.PathLike[str], models: PoseModels) -> None:
    """Write the file atomically. Raises OSError."""
    tensors: dict[str, np.ndarray] = {
        "points": np.ascontiguousarray(models.points, np.float32),
        "origins": np.ascontiguousarray(models.origins, np.float32),
        "symmetries": np.concatenate(models.symmetries).astype(np.float32),
        "symmetry_offsets": np.cumsum([0, *map(len, models.symmetries)]).astype(np.int64),
    }
    write_whole(path, save(tensors, metadata={"names": json.dumps(list(models.names))}))


def read_models(path: str | os.PathLike[str]) -> PoseModels:
    """Read what `write_models` wrote. Raises ModelsError where it is missing or something else."""
    path = Path(path)
    if not path.is_file():
        raise ModelsError(f"no models: {path} does not exist")
    try:
        with safe_open(path, "np") as file:
            names = json.loads((file.metadata() or {})["names"])
            tensors = {name: file.get_tensor(name) for name in _DTYPES}
    except (SafetensorError, KeyError, json.JSONDecodeError) as error:
        raise ModelsError(f"{path} is no file of models: {error!r}") from error
    for name, dtype in _DTYPES.items():
        if tensors[name].dtype != dtype:
            raise ModelsError(f"{path}: tensor {name!r} must be {np.dtype(dtype)}, found {tensors[name].dtype}")
    offsets = tensors["symmetry_offsets"]
    if not len(offsets) or offsets[0] != 0 or offsets[-1] != len(tensors["symmetries"]) or (np.diff(offsets) < 1).any():
        raise ModelsError(f"{path}: symmetry_offsets do not fit {len(tensors['symmetries'])} symmetries")
    symmetries = tuple(np.split(tensors["symmetries"], offsets[1:-1]))
    return PoseModels(tuple(map(str, names)), tensors["points"], symmetries, tensors["origins"])


def _check(name: str, points: np.ndarray, symmetries: np.ndarray) -> None:
    if not np.isfinite(points).all():
        raise ModelsError(f"model {name!r} has points that are not finite")
    size = float(np.ptp(points, axis=0).max())
    if not 0.005 <= size <= 2.0:
        raise ModelsError(f"model {name!r} is {size:.4g} m long, outside 0.005 to 2 m: are its points in millimetres?")
    if symmetries.ndim != 3 or symmetries.shape[1:] != (4, 4) or not len(symmetries):
        raise ModelsError(f"model {name!r}: symmetries must be (S ≥ 1, 4, 4), got {symmetries.shape}")
    if not np.allclose(symmetries[0], np.eye(4), atol=1e-6):
        raise ModelsError(f"model {name!r}: its first symmetry must be the identity")
    turns = symmetries[:, :3, :3].astype(np.float64)
    if not (np.allclose(turns @ turns.transpose(0, 2, 1), np.eye(3), atol=1e-4) and (np.linalg.det(turns) > 0).all()):
        raise ModelsError(f"model {name!r}: its symmetries must be rotations and shifts, no mirror images")


def _diameter(points: np.ndarray) -> float:
    return max(float(np.linalg.norm(points - point, axis=1).max()) for point in points)
