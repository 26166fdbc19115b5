"""A mesh as convex pieces: by CoACD where that takes seconds, else by cutting its surface in halves.

CoACD (Wei et al., "Approximate convex decomposition for 3D meshes with collision-aware concavity and tree search",
SIGGRAPH 2022) cannot be interrupted, takes minutes for a scan of 100,000 faces, and may end the process for a mesh that
it does not like. So it runs in a process of its own, which is stopped after LIMIT_S; larger meshes are not given to it.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from pecgrasp_env.objects.meshing.convex_hulls import convex_hull, cut_in_halves, depth_below, split_round
from pecgrasp_env.objects.meshing.edges import Edges

__all__ = ["COACD", "LIMIT_S", "MOST_FACES", "decompose", "halved"]

# CoACD stops at this concavity (share of the size). The search is shallower than its default (nodes 20, iterations 150,
# depth 3, resolution 2000), which costs a hollow mug of 16,000 faces five times the time for hardly tighter parts.
COACD: dict[str, float] = {
    "threshold": 0.05,
    "max_convex_hull": 48,
    "preprocess_resolution": 30,
    "resolution": 500,
    "mcts_nodes": 6,
    "mcts_iterations": 30,
    "mcts_max_depth": 2,
    "seed": 0,
}
LIMIT_S = 90.0
MOST_FACES = 40_000
_MOST_HALVED = 150_000  # faces; more of them are thinned out first, which moves the surface by half a cell at most
_CELLS = 120  # along the longest side
_MOST_DISTANCES = 10_000_000  # of points of a surface to planes of its hull, at once
_MOST_PIECES = 32
_TOLERANCE = 0.02  # share of the mesh's length that a surface may lie deep in the hull of its piece


def decompose(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Convex parts (K, 3) each of a mesh (V, 3) float64, (F, 3) int32, in its unit; none where it has no volume."""
    parts = _coacd(vertices, faces) if len(faces) <= MOST_FACES else None
    if parts is None:
        parts = halved(*(_coarser(vertices, faces) if len(faces) > _MOST_HALVED else (vertices, faces)))
    # As if the mesh were 200 mm long: hull tolerances are millimetres, and the file's unit is not known here.
    unit = float(np.ptp(vertices, axis=0).max()) / 200
    pieces = []
    for part in (p / unit for p in parts):
        if len(part) >= 4 and np.linalg.matrix_rank(part - part[0], tol=0.02) == 3:
            pieces += split_round(part, thinnest=10.0)
    return [p * unit for p in pieces]


def _coacd(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray] | None:
    """CoACD's parts, or None where it took too long or ended its process."""
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "mesh.npz", Path(folder) / "parts.npz"
        # Scans touch themselves: closed, though some edges have four faces. Remeshed, such a solid becomes a shell.
        faces_of_edge = Edges(faces).count
        as_is = bool((faces_of_edge % 2 == 0).all() and (faces_of_edge > 2).any())
        settings = COACD | {"preprocess_mode": "off" if as_is else "auto"}
        np.savez(given, vertices=vertices, faces=faces)
        arguments = [f"{name}={value}" for name, value in settings.items()]
        command = [
            sys.executable,
            str(Path(__file__).with_name("coacd_process.py")),
            str(given),
            str(found),
            *arguments,
        ]
        try:
            subprocess.run(command, timeout=LIMIT_S, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        except (subprocess.TimeoutExpired, subprocess.CalledProcessError):
            return None
        with np.load(found, allow_pickle=False) as parts:
            return np.split(parts["points"], np.cumsum(parts["counts"])[:-1]) if len(parts["counts"]) else []


def _coarser(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The surface with one vertex for each cell that it passes: of those in it the one furthest from the middle."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = np.floor((vertices - low) / ((high - low).max() / _CELLS)).astype(np.int64)
    key = (cell[:, 0] * (_CELLS + 1) + cell[:, 1]) * (_CELLS + 1) + cell[:, 2]
    far = np.linalg.norm(vertices - (low + high) / 2, axis=1)
    order = np.lexsort((-far, key))
    chosen = order[np.unique(key[order], return_index=True)[1]]
    place = np.searchsorted(key[chosen], key)
    corners = np.sort(place[faces], axis=1)
    kept = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2])
    _, first = np.unique((corners[kept] @ (len(chosen) ** np.array([2, 1, 0]))), return_index=True)
    return vertices[chosen], place[faces[kept][first]].astype(np.int32)


def halved(vertices: np.ndarray, faces: np.ndarray) -> list[np.ndarray]:
    """Hulls (K, 3) of the pieces of a surface, of which the one that lies deepest in its hull is cut in halves.

    Across its two longest axes only: pieces that reach through the mesh along the third have surface on both ends that
    spans them. Coarser than CoACD, as walls that a piece bends around are filled in; the same on any machine.
    """
    sides = np.ptp(vertices, axis=0)
    tolerance, axes = _TOLERANCE * float(sides.max()), np.argsort(sides, kind="stable")[1:]
    pieces = [_Piece.of(vertices, faces)]
    while len(pieces) < _MOST_PIECES:
        deepest = max(pieces, key=lambda piece: piece.depth)
        halves = deepest.halves(axes) if deepest.depth > tolerance else []
        if not halves:
            break
        pieces.remove(deepest)
        pieces += halves
    return [piece.hull.points[piece.hull.vertices] for piece in pieces]


@dataclass(frozen=True, eq=False)
class _Piece:
    """A part of the surface, its hull, and how deep in it the surface lies."""

    vertices: np.ndarray
    faces: np.ndarray
    hull: ConvexHull
    depth: float

    @classmethod
    def of(cls, vertices: np.ndarray, faces: np.ndarray) -> _Piece:
        hull = convex_hull(vertices)
        surface = np.concatenate([vertices, vertices[faces].mean(axis=1)])
        most = min(5000, _MOST_DISTANCES // len(hull.equations))
        return cls(vertices, faces, hull, float(depth_below(surface[:: 1 + len(surface) // most], hull).max()))

    def halves(self, axes: np.ndarray) -> list[_Piece]:
        """By the cut through the middle, across one of `axes`, that leaves the least volume, or nothing."""
        best: list[_Piece] = []
        for axis in axes.tolist():
            # A sliver without volume would be no piece.
            sides = [_Piece.of(*side) for side in cut_in_halves(self.vertices, self.faces, axis)]
            sides = [side for side in sides if side.hull.volume > 1e-4 * self.hull.volume]
            if len(sides) == 2 and (not best or _volume(sides) < _volume(best)):
                best = sides
        return best


def _volume(pieces: list[_Piece]) -> float:
    return sum(float(piece.hull.volume) for piece in pieces)
