"""A mesh as files have it, made into a body: welded, every face once, wound outwards, small holes closed.

Exporters split vertices where texture or normals have a seam, repeat faces for each side, leave slivers and turn faces
inside out. None of that is a hole. What is mended is said in `Body.notes`; what cannot be is left open, or refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.meshing.edges import Edges, turns, unique_rows
from pecgrasp_env.objects.meshing.volume import shells_inside_out

__all__ = ["Body", "mend"]

SEAM = 1e-4  # of the length: how far apart vertices at the border of a surface may lie to be one
SLIVER = 1e-5  # of the length: a face less high than that has no area
SMALL_HOLE = 0.005  # of the surface: a hole up to that is a fault of the file; a larger one is an opening
_MOST_PATCHES = 12  # between edges with four faces, of which all ways to turn them are tried
SHEET = 0.5  # of the surface: where that much is there once for each side, it has no inside


@dataclass(frozen=True, eq=False)
class Body:
    """What physics takes of a mesh, and which faces of the file are drawn."""

    vertices: np.ndarray  # (V, 3) float64, each place once, in the file's unit
    faces: np.ndarray  # (F, 3) int32; counter-clockwise seen from outside where it is closed
    drawn: np.ndarray  # (D, 3) int32, those of the file's faces that are seen
    of_file: np.ndarray  # (D,) their indices in the file
    turned: np.ndarray  # (D,) bool, which of them are wound the other way than in the file
    open_edges: int  # edges that an odd number of faces has; 0: closed
    is_sheet: bool  # the whole surface is there once for each side: a thin shell
    notes: tuple[str, ...]


def mend(vertices: np.ndarray, faces: np.ndarray, name: str) -> Body:
    """The body of a mesh (V, 3), (F, 3). Raises ObjectError, which begins with `name`, where its faces cannot be wound
    alike: a surface with one side, or sheets that meet three and more at an edge.
    """
    notes: list[str] = []
    length = float(np.ptp(vertices, axis=0).max())
    kept, place = unique_rows(vertices)
    vertices = vertices[kept]
    faces = place[faces].astype(np.int32)
    del kept, place
    drawn = np.flatnonzero(_proper(faces))
    faces = _weld_borders(vertices, faces, SEAM * length)
    drawn = drawn[_proper(faces[drawn])]
    if not len(drawn):
        raise ObjectError(f"{name} has no face with an area. Export it anew")
    drawn, solid, is_sheet = _each_once(vertices, faces, drawn, notes)
    needless = _needless_slivers(vertices, faces[solid], SLIVER * length)
    if needless.any():
        notes.append(f"{needless.sum()} faces without area are left out")
        drawn = drawn[~np.isin(drawn, solid[needless])]
        solid = solid[~needless]
    turned = np.zeros(len(faces), bool)
    body = faces[solid]
    patches = np.empty((0, 3), body.dtype)
    if not is_sheet:
        added, patches = _small_holes(vertices, body)
        if len(patches):
            notes.append("small holes are closed")
            vertices = np.concatenate([vertices, added])
            body = np.concatenate([body, patches])
    edges = Edges(body)
    open_edges = int(edges.open.sum())
    turn = _agreeing(edges, name, closed=open_edges == 0)
    if (n_turned := turn[: len(solid)].sum()) and not is_sheet:
        notes.append(f"{n_turned} of {len(solid)} faces were wound against their neighbours and are turned")
    if turn.any():
        body = np.where(turn[:, None], body[:, ::-1], body)
        edges = Edges(body)
    inside_out = shells_inside_out(vertices, body, *edges.shells())
    if inside_out.any():
        if not is_sheet and not open_edges:
            share = "it" if inside_out.all() else "a part of it"
            notes.append(f"{share} was inside out and is turned")
        body = np.where(inside_out[:, None], body[:, ::-1], body)
    turned[solid] = (turn ^ inside_out)[: len(solid)]
    if is_sheet:
        notes.append("each face is there once for each side: it is taken as a thin open shell")
    turned = turned[drawn]
    seen = np.where(turned[:, None], faces[drawn][:, ::-1], faces[drawn])
    used, index = np.unique(np.concatenate([body, seen]), return_inverse=True)
    index = index.reshape(-1, 3).astype(np.int32)
    return Body(
        vertices[used], index[: len(body)], index[len(body) :], drawn, turned, open_edges, is_sheet, tuple(notes)
    )


def _proper(faces: np.ndarray) -> np.ndarray:
    """Which faces have three different corners."""
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)


def _weld_borders(vertices: np.ndarray, faces: np.ndarray, distance: float) -> np.ndarray:
    """The faces, with vertices on borders that lie within a distance of each other made one, where that closes any."""
    proper = faces[_proper(faces)]
    edges = Edges(proper)
    if not edges.open.any():
        return faces
    border = np.unique(edges.ends[edges.open])
    near = cKDTree(vertices[border]).query_pairs(distance, output_type="ndarray")
    if not len(near):
        return faces
    n = len(border)
    _, cluster = connected_components(coo_matrix((np.ones(len(near)), near.T), shape=(n, n)), directed=False)
    _, first = np.unique(cluster, return_index=True)
    index = np.arange(len(vertices))
    index[border] = border[first[cluster]]
    welded = index[faces]
    fewer = Edges(welded[_proper(welded)]).open.sum() < edges.open.sum()
    return welded if fewer else faces


def _each_once(
    vertices: np.ndarray, faces: np.ndarray, drawn: np.ndarray, notes: list[str]
) -> tuple[np.ndarray, np.ndarray, bool]:
    """Of the faces `drawn` those that are seen and those that bound the body, each once, and whether it is a sheet."""
    corners = faces[drawn]
    representative, group = unique_rows(np.sort(corners, axis=1))
    if len(representative) == len(drawn):
        return drawn, drawn, False
    lowest = corners.argmin(axis=1)
    rows = np.arange(len(corners))
    ahead = corners[rows, (lowest + 1) % 3] < corners[rows, (lowest + 2) % 3]
    net = np.bincount(group, weights=np.where(ahead, 1, -1)).astype(int)
    # Of the copies the first one that is wound as most are.
    wanted = np.flatnonzero((ahead == (net[group] > 0)) | (net[group] == 0))
    once = wanted[np.unique(group[wanted], return_index=True)[1]]
    once = np.sort(once)
    paired = (net == 0)[group[once]]
    area = _areas(vertices, corners[once])
    share = float(area[paired].sum() / max(area.sum(), 1e-300))
    edges = Edges(corners[once])
    if not edges.open.any():
        notes.append(f"{len(drawn) - len(once)} faces were there twice")
        return drawn[once], drawn[once], False
    rest = once[~paired]
    if share < SHEET and len(rest) and not Edges(corners[rest]).open.any():
        free = edges.faces_at(edges.count == 1)[paired].any()
        if free and share > 0.01:
            notes.append(f"{100 * share:.0f} % of its surface is sheets without thickness: drawn, but not touched")
        elif share > 0.001:
            notes.append(f"{len(drawn) - len(rest)} faces stood against another at the same place")
        return drawn[once], drawn[rest], False
    if share < SHEET:
        notes.append(f"{len(drawn) - len(once)} faces were there twice")
    return drawn[once], drawn[once], share >= SHEET


def _areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _needless_slivers(vertices: np.ndarray, faces: np.ndarray, height: float) -> np.ndarray:
    """Which faces have no area and at least two edges that only they have, so that without them less is open."""
    sides = vertices[faces[:, [1, 2, 0]]] - vertices[faces]
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    thin = 2 * _areas(vertices, faces) < height * longest
    needless = np.zeros(len(faces), bool)
    for _ in range(10):  # a fan of slivers goes from its end
        left = np.flatnonzero(~needless)
        if not thin[left].any():
            break
        edges = Edges(faces[left])
        found = thin[left] & (edges.faces_at(edges.open) >= 2)
        if not found.any():
            break
        needless[left[found]] = True
    return needless


def _small_holes(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (A, 3) to add and faces (P, 3) that close the small holes."""
    edges = Edges(faces)
    open_ends = edges.ends[edges.open & (edges.count == 1)]
    added: list[np.ndarray] = []
    patches: list[tuple[int, int, int]] = []
    if len(open_ends):
        least = SMALL_HOLE * _areas(vertices, faces).sum()
        for loop in _loops(open_ends):
            points = vertices[loop]
            middle = points.mean(axis=0)
            spokes = points - middle
            if np.linalg.norm(np.cross(spokes, np.roll(spokes, -1, axis=0)), axis=1).sum() / 2 > least:
                continue
            if len(loop) == 3:
                patches.append((loop[0], loop[1], loop[2]))
                continue
            hub = len(vertices) + len(added)
            added.append(middle)
            patches += [(a, b, hub) for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)]
    return np.array(added).reshape(-1, 3), np.array(patches, faces.dtype).reshape(-1, 3)


def _loops(ends: np.ndarray) -> list[list[int]]:
    """The closed chains of edges (E, 2) in which each vertex has two of them."""
    neighbours: dict[int, list[int]] = {}
    for a, b in ends.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    loops, seen = [], set()
    for start in neighbours:
        chain, before, here = [start], -1, start
        while here not in seen and len(neighbours[here]) == 2:
            seen.add(here)
            following = neighbours[here][neighbours[here][0] == before]
            before, here = here, following
            if here == start:
                loops.append(chain)
                break
            chain.append(here)
    return [loop for loop in loops if len(loop) >= 3]


def _agreeing(edges: Edges, name: str, closed: bool) -> np.ndarray:
    """Which faces to turn, so that neighbours are wound alike; of an open surface as far as that is possible."""
    wrong = edges.faces_at(edges.balance() != 0) > 0
    if closed and not wrong.any():
        return np.zeros(edges.n_faces, bool)
    turn, one_sided = turns(edges)
    if not closed:
        return turn & ~one_sided
    group = edges.groups()
    mended = np.isin(group, group[wrong])  # the other parts are right as they are
    turn &= mended
    if not one_sided[mended].any():
        turn ^= _patches_to_turn(edges, turn)
        if not edges.balance(turn).any():
            return turn
    raise ObjectError(
        f"{name} has faces wound both ways that cannot be turned to agree, so it has no inside. Recalculate its "
        "normals (Blender: Mesh, Normals, Recalculate Outside; MeshLab: Re-Orient All Faces Coherently) and export it "
        "anew"
    )


def _patches_to_turn(edges: Edges, turned: np.ndarray) -> np.ndarray:
    """Where four and more faces meet at edges: which of the patches between them to turn, (F,)."""
    patch = edges.patches()
    uneven = edges.balance(turned) != 0
    ways = np.zeros(edges.n_faces, bool)
    concerned = np.unique(patch[edges.faces_at(uneven) > 0])
    if not 0 < len(concerned) <= _MOST_PATCHES:
        return ways
    sides = np.where(edges.forward ^ np.repeat(turned, 3), 1, -1)
    meet = edges.count > 2
    runs = np.stack(
        [np.bincount(edges.of_side, sides * np.repeat(patch == p, 3), len(edges.count))[meet] for p in concerned]
    )
    rest = edges.balance(turned)[meet] - runs.sum(axis=0)
    # All ways to turn them but for the first, of which the one that turns the fewest comes first.
    tries = np.array([(0, *each) for each in product((0, 1), repeat=len(concerned) - 1)])
    agree = ((1 - 2 * tries) @ runs + rest == 0).all(axis=1)
    if agree.any():
        chosen = tries[agree][tries[agree].sum(axis=1).argmin()]
        ways = np.isin(patch, concerned[chosen == 1])
    return ways
