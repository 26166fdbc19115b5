"""Known objects: meshes made ready once for finding them in clouds, and remembered in a cache."""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.errors import DAMAGED_NPZ, ModelError, require_between
from grasping.pose.mesh_file import OPENING, SUFFIXES, Mesh, areas, checked, diameter, read_mesh
from grasping.pose.poisson_disk import eliminate, surface_points
from grasping.pose.seen_surface import FEWEST, directions_around, times_seen
from grasping.pose.symmetry import TOLERANCE, Symmetry, find_symmetry

FloatArray = NDArray[np.float64]

N_POINTS = 1500  # of a model's surface
_CROWD = 5  # random points for each that stays (Yuksel's advice)
_DENSE = 30_000  # random points that hide one another
ALIKE = 0.02  # of the diameter: two models whose farthest points lie so near are alike
_FORMAT = b"1"  # change it when the way of preparing changes, so that older files are not taken for new ones


class ModelWarning(UserWarning):
    """Two models that no cloud tells apart."""


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """A known object, in the frame of its mesh file, m.

    name: of the instance, unique among the loaded. label: its class, the folder's name; the name where there is none.
    vertices: (V, 3) float64, faces: (F, 3) int32, counter-clockwise seen from outside. points: (N, 3) float64, Poisson
    disk samples of what can be seen of the surface; normals: (N, 3) float64, unit, outwards. diameter: the greatest
    distance of two points. symmetry: the turns that leave it as it is.
    """

    name: str
    label: str
    vertices: FloatArray
    faces: NDArray[np.int32]
    points: FloatArray
    normals: FloatArray
    diameter: float
    symmetry: Symmetry


def load_models(
    folder: str | os.PathLike[str],
    *,
    classes: Sequence[str] | None = None,
    scale: float = 1.0,
    n_points: int = N_POINTS,
    allow_open: bool = False,
) -> list[ObjectModel]:
    """The models of FOLDER/<class>/<instance>.ply|obj|stl|glb|off, and of FOLDER/<name>.ply, by class and name.

    classes: only these. scale: metres in a unit of the files. allow_open: take meshes with large openings, as thin
    shells that are seen from both sides. An instance is called by its file's name, by CLASS/NAME where two have one.
    Raises ModelError: no such folder, no meshes in it, an unknown class, a mesh that is none (`mesh_file.checked`), or
    one that is there twice. Warns (ModelWarning) of two that are alike.
    """
    root = Path(folder)
    if not root.is_dir():
        raise ModelError(f"models = {str(folder)!r} is not a folder")
    files = [(path.stem, path) for path in _meshes(root)]
    for sub in sorted(each for each in root.iterdir() if each.is_dir() and not each.name.startswith(".")):
        files += [(sub.name, path) for path in _meshes(sub)]
    labels = [label for label, _ in files]
    for label in classes or ():
        if label not in labels:
            raise ModelError(f"no class {label!r} in {root}; it has {', '.join(dict.fromkeys(labels)) or 'none'}")
    chosen = [each for each in files if classes is None or each[0] in classes]
    if not chosen:
        raise ModelError(f"{root} has no meshes: expected {root}/<class>/<instance>{{{','.join(SUFFIXES)}}}")
    names = [path.stem for _, path in chosen]
    models = []
    read: dict[str, Path] = {}
    for label, path in chosen:
        data = hashlib.sha256(path.read_bytes()).hexdigest()
        if data in read:
            raise ModelError(f"{path} and {read[data]} are one mesh: no cloud tells them apart. Remove one of the two")
        read[data] = path
        name = path.stem if names.count(path.stem) == 1 else f"{label}/{path.stem}"
        vertices, faces = read_mesh(path, scale)
        models.append(
            object_model(
                vertices, faces, name, label, n_points=n_points, allow_open=allow_open, origin=str(path), scale=scale
            )
        )
    for one, other in alike(models):
        warnings.warn(
            f"models {one.name} ({one.label}) and {other.name} ({other.label}) are alike: a cloud fits both, and which "
            "of the two is found is chance. Remove one, or give both one class",
            ModelWarning,
            stacklevel=2,
        )
    return models


def object_model(
    vertices: ArrayLike,
    faces: ArrayLike,
    name: str,
    label: str | None = None,
    *,
    n_points: int = N_POINTS,
    allow_open: bool = False,
    origin: str | None = None,
    scale: float = 1.0,
) -> ObjectModel:
    """The model of a mesh (V, 3), (F, 3), m; the same whenever it is made, and from the cache the second time.

    origin: what errors call it; scale: what they say it was multiplied by. Raises ModelError (`mesh_file.checked`),
    ConfigError for fewer than 50 points.
    """
    require_between("n_points", n_points, 50, _DENSE // _CROWD)
    label = name if label is None else label
    corners, triangles = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.int32)
    key = hashlib.sha256(_FORMAT + repr((n_points, allow_open, TOLERANCE, corners.shape)).encode())
    key.update(corners.tobytes() + triangles.tobytes())
    file = cache_folder() / f"{key.hexdigest()[:32]}.npz"
    if (stored := _stored(file, name, label)) is not None:
        return stored
    mesh = checked(corners, triangles, origin or name, allow_open, scale)
    area = float(areas(mesh.vertices, mesh.faces).sum())
    dense, dense_normals = _seen(mesh, area)
    if len(dense) < n_points:
        raise ModelError(f"{origin or name}: hardly any of its surface can be seen from outside. Export it anew")
    size = diameter(mesh.vertices)
    # `dense` is in the order of the faces: every so manieth of it is uniform over the surface, too.
    some = np.linspace(0, len(dense) - 1, min(len(dense), _CROWD * n_points)).round().astype(int)
    kept = some[eliminate(dense[some], dense_normals[some], area * len(dense) / _DENSE, n_points)]
    symmetry = find_symmetry(dense, dense_normals, size)
    model = ObjectModel(name, label, mesh.vertices, mesh.faces, dense[kept], dense_normals[kept], size, symmetry)
    _store(file, model)
    return model


def alike(models: Sequence[ObjectModel], share: float = ALIKE) -> list[tuple[ObjectModel, ObjectModel]]:
    """The pairs that no cloud tells apart: turned and moved, each point of either lies within that share of the
    diameter on the other.
    """
    return [pair for pair in combinations(models, 2) if _fit(*pair) <= share]


def cache_folder() -> Path:
    """`$XDG_CACHE_HOME/pecgrasp/models`, or the same below `~/.cache`."""
    root = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(root) / "pecgrasp" / "models"


def _meshes(folder: Path) -> list[Path]:
    return sorted(f for f in folder.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith("."))


def _seen(mesh: Mesh, area: float) -> tuple[FloatArray, FloatArray]:
    """Points of the surface that are seen from outside and normals on the side that is seen, uniform over it.

    A part that is seen from behind, as the inner shell of a cup, is turned; a thin shell has points for both sides.
    """
    points, normals, face = surface_points(mesh.vertices, mesh.faces, _DENSE, np.random.default_rng(0))
    times = times_seen(points, normals, area)
    if mesh.opening > OPENING:
        before, behind = (times >= FEWEST).T
        return np.concatenate([points[before], points[behind]]), np.concatenate([normals[before], -normals[behind]])
    part = mesh.part[face]
    of_part = np.stack([np.bincount(part, side, mesh.part.max() + 1) for side in times.T], axis=1)
    # Through a wall that is thinner than the pictures are fine it is seen from behind, too, but less often.
    turned = (of_part[:, 1] > 2 * of_part[:, 0])[part]
    kept = np.where(turned, times[:, 1], times[:, 0]) >= FEWEST
    return points[kept], np.where(turned[:, None], -normals, normals)[kept]


def _fit(one: ObjectModel, other: ObjectModel) -> float:
    """How far the farthest points are off, in shares of the diameter, where the two are laid onto each other."""
    size = max(one.diameter, other.diameter)
    if min(one.diameter, other.diameter) < (1 - 2 * ALIKE) * size:
        return np.inf
    frames = [np.linalg.eigh(np.cov(model.points.T)) for model in (one, other)]
    if np.abs(np.sqrt(frames[0][0]) - np.sqrt(frames[1][0])).max() > 2 * ALIKE * size:
        return np.inf
    trees = [cKDTree(model.points) for model in (one, other)]
    middles = [model.points.mean(axis=0) for model in (one, other)]
    spacing = float(np.median(trees[1].query(other.points, k=2)[0][:, 1]))
    # Where two moments are alike the axes say nothing, so that other turns are tried, too.
    starts = [
        frames[1][1] @ np.diag(signs) @ frames[0][1].T for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))
    ]
    if np.diff(np.sqrt(frames[0][0])).min() < 0.05 * size:
        starts += [_frame(d) @ frames[0][1].T for d in directions_around(60)]
    best = np.inf
    for start in starts:
        rotation = start * np.sign(np.linalg.det(start))
        shift = middles[1] - rotation @ middles[0]
        for _ in range(12):
            moved = one.points @ rotation.T + shift
            near = other.points[trees[1].query(moved)[1]]
            u, _, vt = np.linalg.svd((moved - moved.mean(axis=0)).T @ (near - near.mean(axis=0)))
            turn = vt.T @ np.diag([1, 1, np.linalg.det(vt.T @ u.T)]) @ u.T
            rotation, shift = turn @ rotation, turn @ (shift - moved.mean(axis=0)) + near.mean(axis=0)
        there = trees[1].query(one.points @ rotation.T + shift)[0].max()
        back = trees[0].query((other.points - shift) @ rotation)[0].max()
        best = min(best, max(float(there), float(back)) - 0.8 * spacing)
    return best / size


def _frame(direction: FloatArray) -> FloatArray:
    """A right-handed frame (3, 3) whose last axis is the direction."""
    u = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(direction, u), direction], axis=1)


def _stored(file: Path, name: str, label: str) -> ObjectModel | None:
    try:
        with np.load(file) as data:
            axis = (data["axis"][0], data["axis"][1]) if len(data["axis"]) else None
            symmetry = Symmetry(data["turns"], axis, data["ball"] if len(data["ball"]) else None)
            return ObjectModel(
                name,
                label,
                data["vertices"],
                data["faces"],
                data["points"],
                data["normals"],
                float(data["diameter"]),
                symmetry,
            )
    except DAMAGED_NPZ:  # not there, or half of it
        return None


def _store(file: Path, model: ObjectModel) -> None:
    """Whole or not at all; where there is no room or right to write, it is prepared anew the next time."""
    symmetry = model.symmetry
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        temporary = file.with_name(f"{file.stem}.{os.getpid()}.tmp.npz")
        np.savez(
            temporary,
            vertices=model.vertices,
            faces=model.faces,
            points=model.points,
            normals=model.normals,
            diameter=model.diameter,
            turns=symmetry.turns,
            axis=np.stack(symmetry.axis) if symmetry.axis is not None else np.empty((0, 3)),
            ball=np.empty(0) if symmetry.ball is None else symmetry.ball,
        )
        os.replace(temporary, file)
    except OSError:
        return
