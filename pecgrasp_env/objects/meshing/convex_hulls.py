"""Convex pieces: how simple a hull may be, and how many slices of a solid one hull may swallow.

Everything here is unit-agnostic; the generators work in millimetres and their tolerances are millimetres.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from trimesh.intersections import slice_faces_plane

# On a GPU PhysX takes 64 of each; a few less, as rounding may split a face that is flat here.
MAX_HULL_VERTICES = 60
MAX_HULL_FACES = 58
SKIPPED = 0.5  # mm, how far a hull may leave a corner of its slice outside
# mm; a thinner hull PhysX replaces by the box around it: a disc of 0.13 mm by a square whose corners stick out
THINNEST = 0.2


def convex_hull(points: np.ndarray) -> ConvexHull:
    """Hull of (N, 3) points; the points are nudged (QJ) only where Qhull refuses flat or needle-shaped input."""
    try:
        return ConvexHull(points)
    except QhullError:
        return ConvexHull(points, qhull_options="QJ")


def hull_volume(points: np.ndarray) -> float:
    """Volume of the convex hull of (N, 3) points, in the cube of their unit."""
    return float(convex_hull(points).volume)


def thickness(points: np.ndarray) -> float:
    """The least extent of (N, 3) points across a face of their hull."""
    equations = convex_hull(points).equations
    return float(-(points @ equations[:, :3].T + equations[:, 3]).min(axis=0).max())


def depth_below(points: np.ndarray, hull: ConvexHull) -> np.ndarray:
    """How deep each of (N, 3) points lies inside the hull, (N,); negative outside."""
    return -(points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)


def simplify_hull(points: np.ndarray, tolerance: float = 0.2, hull: ConvexHull | None = None) -> np.ndarray:
    """Few of the given (N, 3) points, (K, 3), whose hull leaves none of them further outside than `tolerance`.

    Greedy: start from the extremes along 13 axes, add the points furthest outside, stop at the tolerance or where
    MAX_HULL_VERTICES or MAX_HULL_FACES would be passed. The result never leaves the hull of the input, which may be
    given where it is known.
    """
    corners = points[(convex_hull(points) if hull is None else hull).vertices]
    if len(corners) <= 12:
        return corners
    axes = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)])
    along = corners @ axes.T
    chosen = list(dict.fromkeys(np.concatenate([along.argmax(axis=0), along.argmin(axis=0)]).tolist()))
    hull = convex_hull(corners[chosen])
    batch = 8
    while True:
        # The furthest point of each facet's outside set: several at once save most of the hulls.
        heights = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
        outside, facet = heights.max(axis=1), heights.argmax(axis=1)
        order = np.argsort(-outside, kind="stable")
        order = order[outside[order] > tolerance]
        _, first = np.unique(facet[order], return_index=True)
        worst = [int(i) for i in order[np.sort(first)] if i not in chosen]
        finer = None
        while worst and batch:
            new = worst[: min(batch, MAX_HULL_VERTICES - len(chosen))]
            finer = convex_hull(corners[chosen + new]) if new else None
            if finer is None or not _too_many_faces(finer):
                break
            finer, batch = None, batch // 2  # one face too many: add fewer
        if finer is None:
            return hull.points[np.unique(hull.vertices)]
        chosen, hull = chosen + new, finer


def _too_many_faces(hull: ConvexHull) -> bool:
    """Whether there are more than MAX_HULL_FACES when triangles in one plane count as one."""
    normals = hull.equations[:, :3]
    return len(normals) > MAX_HULL_FACES and len(np.unique(np.round(normals, 3), axis=0)) > MAX_HULL_FACES


def left_outside(points: np.ndarray, kept: np.ndarray) -> float:
    """Furthest distance of any of (N, 3) points outside the hull of the kept ones."""
    return float(-depth_below(points, convex_hull(kept)).min())


def group_sections(sections: np.ndarray, tolerance: float) -> list[np.ndarray]:
    """Convex hulls that follow a loft: runs of consecutive sections, as long as the hull stays near the surface.

    sections: (S, K, 3). A run grows while no inner section lies deeper than `tolerance` in the hull of the run and the
    simplified hull leaves nothing further outside than SKIPPED: a straight or gently bulging stretch becomes one hull,
    a waist or a bend is cut. What is thinner than THINNEST is left out, unless all is. Returns a list of (M, 3) hull
    vertices.
    """
    hulls = []
    start = 0
    last = len(sections) - 1
    while start < last:
        end, step = start + 1, 1
        kept = simplify_hull(sections[start : end + 1].reshape(-1, 3))
        while step and end < last:  # gallop: double the stride while it fits, halve it where it does not
            further = min(end + step, last)
            longer = _fitting_hull(sections[start : further + 1], tolerance)
            if longer is None:
                step //= 2
            else:
                end, kept, step = further, longer, 2 * step
        hulls.append(kept)
        start = end
    return [hull for hull in hulls if thickness(hull) >= THINNEST] or hulls


def _fitting_hull(run: np.ndarray, tolerance: float) -> np.ndarray | None:
    points = run.reshape(-1, 3)
    hull = convex_hull(points)
    if depth_below(run[1:-1].reshape(-1, 3), hull).max() > tolerance:
        return None
    kept = simplify_hull(points, hull=hull)
    return kept if left_outside(points, kept) <= SKIPPED else None


def carve(vertices: np.ndarray, faces: np.ndarray, tolerance: float, thinnest: float) -> list[np.ndarray]:
    """Convex hulls of a closed mesh, halved across x and y until each piece fits.

    A piece is cut while a vertex or a triangle's centre lies deeper than `tolerance` in its hull, or the simplified
    hull leaves a vertex further outside than SKIPPED, across the axis that leaves the least volume of hulls; no piece
    becomes thinner than `thinnest`. Pieces reach through the mesh from below to above, so their surface spans them and
    no cap is needed. vertices (V, 3), faces (F, 3); returns a list of (M, 3) hull vertices.
    """
    hull = convex_hull(vertices)
    kept = simplify_hull(vertices, hull=hull)
    surface = np.concatenate([vertices, vertices[faces].mean(axis=1)])
    if depth_below(surface, hull).max() <= tolerance and left_outside(vertices, kept) <= SKIPPED:
        return [kept]
    best = None
    for axis in (0, 1):
        if np.ptp(vertices[:, axis]) < 2 * thinnest:
            continue
        # The cut may leave a sliver on one side.
        halves = [(v, f) for v, f in cut_in_halves(vertices, faces, axis) if hull_volume(v) > 1e-4 * hull.volume]
        volume = sum(hull_volume(v) for v, _ in halves)
        if best is None or volume < best[0]:
            best = volume, halves
    if best is None:
        return [kept]
    return [piece for v, f in best[1] for piece in carve(v, f, tolerance, thinnest)]


def split_round(points: np.ndarray, thinnest: float) -> list[np.ndarray]:
    """The hull of (N, 3) points as simplified hulls, halved across its longest side while one leaves more than SKIPPED.

    For convex bodies too round for one hull of few faces; no piece becomes thinner than `thinnest`.
    """
    kept = simplify_hull(points)
    longest = int(np.ptp(points, axis=0).argmax())
    if left_outside(points, kept) <= SKIPPED or np.ptp(points[:, longest]) < 2 * thinnest:
        return [kept]
    hull = convex_hull(points)
    return [piece for v, _ in cut_in_halves(hull.points, hull.simplices, longest) for piece in split_round(v, thinnest)]


def cut_in_halves(vertices: np.ndarray, faces: np.ndarray, axis: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """The surface on either side of the middle of its extent along an axis, open at the cut: (V, 3) and (F, 3) each.

    A side with fewer than four vertices is left out.
    """
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    halves = []
    for sign in (1.0, -1.0):
        v, f, *_ = slice_faces_plane(vertices, faces, sign * np.eye(3)[axis], middle)
        used, index = np.unique(f, return_inverse=True)
        if len(used) >= 4:
            halves.append((v[used], index.reshape(-1, 3)))
    return halves
