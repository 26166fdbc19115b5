"""A mesh file, checked: triangles in metres, each place once, wound outwards."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.distance import cdist

from grasping.errors import ModelError

FloatArray = NDArray[np.float64]
FaceArray = NDArray[np.int32]

SUFFIXES = (".ply", ".obj", ".stl", ".glb", ".gltf", ".off")
SMALLEST, LARGEST = 0.005, 2.0  # m, the longest side that an object for a hand may have
FLAT = 1e-4  # of the cube over the longest side: a hull of less volume is a sheet
OPENING = 0.02  # of the surface: up to that a hole is a fault of the scan, beyond it an opening


@dataclass(frozen=True, eq=False)
class Mesh:
    """vertices: (V, 3) float64, m. faces: (F, 3) int32, counter-clockwise seen from outside as far as that can be told.

    part: (F,) number of the connected part that a face is of. opening: of its holes the area, as that of circles of
    their length, in shares of its surface.
    """

    vertices: FloatArray
    faces: FaceArray
    part: NDArray[np.int32]
    opening: float


def read_mesh(path: Path, scale: float = 1.0) -> tuple[FloatArray, FaceArray]:
    """The triangles of a file, all its geometries together, times `scale`: metres in a unit of the file.

    Raises ModelError where it cannot be read or has no faces, ImportError without the extra `pose`.
    """
    if find_spec("trimesh") is None:
        raise ImportError("meshes are read with trimesh: pip install 'pecgrasp[pose]'")
    import trimesh

    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL)  # it prints a traceback for each texture that is not there
    try:
        found = [m for m in trimesh.load_scene(str(path), process=False).dump() if len(getattr(m, "faces", ()))]
    except Exception as error:  # each format's reader has exceptions of its own
        raise ModelError(
            f"{path} cannot be read as a mesh: {type(error).__name__}: {error}. Export it anew as .ply or .obj"
        ) from error
    finally:
        log.setLevel(level)
    if not found:
        raise ModelError(f"{path} has no faces: a model needs a surface, not only points. Export it with its faces")
    starts = np.cumsum([0] + [len(m.vertices) for m in found[:-1]])
    vertices = np.concatenate([np.asarray(m.vertices, np.float64) for m in found]) * scale
    faces = np.concatenate([np.asarray(m.faces, np.int64) + s for m, s in zip(found, starts, strict=True)])
    return vertices, faces.astype(np.int32)


def checked(vertices: FloatArray, faces: FaceArray, name: str, allow_open: bool = False, scale: float = 1.0) -> Mesh:
    """The mesh (V, 3), (F, 3) welded and wound outwards. allow_open: take it with large openings, as a thin shell.

    Raises ModelError, which begins with `name`, for coordinates that are no numbers, a size that no object for a hand
    has (it says where that speaks of millimetres), and what encloses no volume: a sheet, or a surface with openings.
    """
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise ModelError(f"{name}: vertices {vertices.shape} and faces {faces.shape}, expected (V, 3) and (F, 3)")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ModelError(f"{name} has faces that name vertices beyond its {len(vertices)}")
    if not np.isfinite(vertices[np.unique(faces)]).all():
        raise ModelError(f"{name} has vertices that are not numbers. Export it anew")
    _check_size(vertices[np.unique(faces)], name, scale)
    vertices, faces = _welded(vertices, faces)
    if not len(faces):
        raise ModelError(f"{name} has no face with an area. Export it anew")
    _check_volume(vertices, name)
    faces, part, opening = _wound(vertices, faces)
    if opening > OPENING and not allow_open:
        raise ModelError(
            f"{name} is not closed: its openings are {100 * opening:.0f} % of its surface, so it encloses no volume. "
            "Close its holes (MeshLab: Close Holes; Blender: Fill Holes), or take it as a thin shell with "
            "allow_open=true"
        )
    return Mesh(vertices, faces, part, opening)


def areas(vertices: FloatArray, faces: FaceArray) -> FloatArray:
    """Of each face, (F,)."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2, np.float64)


def diameter(vertices: FloatArray) -> float:
    """Greatest distance of two points (V, 3) that are in no plane."""
    corners = vertices[ConvexHull(vertices).vertices]
    return max(float(cdist(block, corners).max()) for block in np.array_split(corners, -(-len(corners) // 500)))


def _check_size(vertices: FloatArray, name: str, scale: float) -> None:
    longest = float(np.ptp(vertices, axis=0).max())
    if SMALLEST <= longest <= LARGEST:
        return
    message = f"{name} is {longest:.4g} m long, outside {SMALLEST} to {LARGEST} m"
    for factor, unit in ((1e-3, "millimetres"), (1e-2, "centimetres")):
        if SMALLEST <= longest * factor <= LARGEST:
            raise ModelError(f"{message}. If its unit is {unit}, say scale={scale * factor:g}")
    raise ModelError(f"{message}. scale is {scale:g}: metres in one unit of the file")


def _check_volume(vertices: FloatArray, name: str) -> None:
    longest = float(np.ptp(vertices, axis=0).max())
    try:
        volume = ConvexHull(vertices).volume
    except QhullError:
        volume = 0.0
    if volume < FLAT * longest**3:
        raise ModelError(f"{name} is a flat sheet: it encloses no volume. Give it a thickness")


def _welded(vertices: FloatArray, faces: FaceArray) -> tuple[FloatArray, FaceArray]:
    """Vertices at one place made one, and faces without area or there twice left out."""
    unit = 1e-6 * float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    keys = np.round(vertices[faces.reshape(-1)] / unit).astype(np.int64)
    _, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    place = vertices[faces.reshape(-1)[first]]
    welded = index.reshape(-1, 3).astype(np.int32)
    a, b, c = welded.T
    welded = welded[(a != b) & (b != c) & (c != a)]
    welded = welded[areas(place, welded) > 0] if len(welded) else welded
    _, once = np.unique(np.sort(welded, axis=1), axis=0, return_index=True)
    return place, welded[np.sort(once)]


def _wound(vertices: FloatArray, faces: FaceArray) -> tuple[FaceArray, NDArray[np.int32], float]:
    """The faces, neighbours wound alike and each connected part outwards; their parts; the share of the openings."""
    n = len(faces)
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    of_face = np.repeat(np.arange(n), 3)
    forward = ends[:, 0] < ends[:, 1]
    _, edge, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    order = np.argsort(edge, kind="stable")
    starts = np.concatenate([[0], np.cumsum(count)[:-1]])[count == 2]
    first, second = order[starts], order[starts + 1]
    one, other = of_face[first], of_face[second]
    against = forward[first] == forward[second]  # neighbours that run along their edge the same way
    # 1: alike, 2: against; a face is turned where the path to it from its part's first face has an odd number of 2s.
    graph = coo_matrix((np.where(against, 2, 1), (one, other)), shape=(n, n)).tocsr()
    graph = graph.maximum(graph.T)
    n_parts, part = connected_components(graph, directed=False)
    turn = np.zeros(n, bool)
    corners = vertices[faces]
    if against.any():
        for k in np.unique(part[np.concatenate([one[against], other[against]])]):
            seen, before = breadth_first_order(graph, int(np.flatnonzero(part == k)[0]), directed=False)
            kinds = np.asarray(graph[before[seen[1:]], seen[1:]]).reshape(-1)
            for face, kind in zip(seen[1:].tolist(), kinds.tolist(), strict=True):
                turn[face] = turn[before[face]] ^ (kind == 2)
    # Outwards as seen from the part's own middle, so that it holds for an open shell, too.
    middles = np.stack([np.bincount(part, corners.mean(axis=1)[:, k], n_parts) for k in range(3)], axis=1)
    middle = np.asarray(middles / np.bincount(part, minlength=n_parts)[:, None], np.float64)
    local = corners - middle[part][:, None]
    six = np.einsum("ij,ij->i", local[:, 0], np.cross(local[:, 1], local[:, 2])) * np.where(turn, -1, 1)
    turn ^= (np.bincount(part, six, n_parts) < 0)[part]
    border = np.flatnonzero(count[edge] == 1)
    opening = 0.0
    if len(border):
        rim = ends[border]
        _, loop = connected_components(
            coo_matrix((np.ones(len(rim)), rim.T), shape=(len(vertices),) * 2), directed=False
        )
        length = np.bincount(loop[rim[:, 0]], np.linalg.norm(vertices[rim[:, 0]] - vertices[rim[:, 1]], axis=1))
        opening = float((length**2).sum() / (4 * np.pi) / areas(vertices, faces).sum())
    return np.where(turn[:, None], faces[:, ::-1], faces).astype(np.int32), part, opening
