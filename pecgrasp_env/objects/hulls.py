"""Convex pieces: how simple a hull may be, and how many slices of a solid one hull may swallow.

Everything here is unit-agnostic; the generators work in millimetres and their tolerances are millimetres.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

MAX_HULL_VERTICES = 32  # at most 60 triangles: PhysX on a GPU takes 64 vertices and 64 faces a hull


def convex_hull(points: np.ndarray) -> ConvexHull:
    """Hull of (N, 3) points; the points are nudged (QJ) only where Qhull refuses flat or needle-shaped input."""
    try:
        return ConvexHull(points)
    except QhullError:
        return ConvexHull(points, qhull_options="QJ")


def hull_volume(points: np.ndarray) -> float:
    """Volume of the convex hull of (N, 3) points, in the cube of their unit."""
    return float(convex_hull(points).volume)


def depth_below(points: np.ndarray, hull: ConvexHull) -> np.ndarray:
    """How deep each of (N, 3) points lies inside the hull, (N,); negative outside."""
    return -(points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)


def simplify_hull(points: np.ndarray, tolerance: float = 0.25, max_vertices: int = MAX_HULL_VERTICES) -> np.ndarray:
    """Few of the given (N, 3) points whose hull leaves none of them further outside than `tolerance`.

    Greedy: start from the extremes along 13 axes, add the point furthest outside, stop at the tolerance or at
    `max_vertices` (K, 3). The result never leaves the hull of the input.
    """
    corners = points[convex_hull(points).vertices]
    if len(corners) <= 12:
        return corners
    axes = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (x, y, z) > (0, 0, 0)])
    along = corners @ axes.T
    chosen = list(dict.fromkeys(np.concatenate([along.argmax(axis=0), along.argmin(axis=0)]).tolist()))
    if len(chosen) < 5 or np.linalg.matrix_rank(corners[chosen] - corners[chosen[0]], tol=1e-6) < 3:
        return corners[:max_vertices]
    hull = convex_hull(corners[chosen])
    while len(chosen) < max_vertices:
        # The furthest point of each facet's outside set: several at once save most of the hulls.
        heights = corners @ hull.equations[:, :3].T + hull.equations[:, 3]
        outside, facet = heights.max(axis=1), heights.argmax(axis=1)
        order = np.argsort(-outside, kind="stable")
        order = order[outside[order] > tolerance]
        _, first = np.unique(facet[order], return_index=True)
        new = [int(i) for i in order[np.sort(first)][:6] if i not in chosen]
        if not new:
            break
        chosen += new[: max_vertices - len(chosen)]
        hull = convex_hull(corners[chosen])
    return hull.points[np.unique(hull.vertices)]


def group_sections(sections: np.ndarray, tolerance: float) -> list[np.ndarray]:
    """Convex hulls that follow a loft: runs of consecutive sections, as long as the hull stays near the surface.

    sections: (S, K, 3). A run grows while no inner section lies deeper than `tolerance` in the hull of the run, so a
    straight or bulging stretch becomes one hull and a waist or a bend is cut. Returns a list of (M, 3) hull vertices.
    """
    hulls = []
    start = 0
    last = len(sections) - 1
    while start < last:
        end = start + 1
        while end < last:
            run = sections[start : end + 2]
            deepest = depth_below(run[1:-1].reshape(-1, 3), convex_hull(run.reshape(-1, 3))).max()
            if deepest > tolerance:
                break
            end += 1
        hulls.append(simplify_hull(sections[start : end + 1].reshape(-1, 3)))
        start = end
    return hulls


def slab_hulls(
    vertices: np.ndarray, faces: np.ndarray, axis: int, tolerance: float, thinnest: float
) -> list[np.ndarray]:
    """Convex hulls of a closed mesh cut into slabs across one axis, halved until each fits.

    A slab is halved while a vertex lies deeper than `tolerance` in its hull and the slab is thicker than
    2 * `thinnest`. vertices (V, 3), faces (F, 3); returns a list of (M, 3) hull vertices.
    """
    edges = np.unique(np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1), axis=0)
    height = vertices[:, axis]

    def crossings(level: float) -> np.ndarray:
        a, b = edges[:, 0], edges[:, 1]
        cut = (height[a] - level) * (height[b] - level) < 0
        a, b = a[cut], b[cut]
        t = ((level - height[a]) / (height[b] - height[a]))[:, None]
        return vertices[a] * (1 - t) + vertices[b] * t

    def split(low: float, high: float) -> list[np.ndarray]:
        inside = vertices[(height >= low) & (height <= high)]
        points = np.concatenate([inside, crossings(low), crossings(high)])
        if len(points) < 4:
            return []
        if high - low > 2 * thinnest and len(inside) and depth_below(inside, convex_hull(points)).max() > tolerance:
            middle = (low + high) / 2
            return split(low, middle) + split(middle, high)
        return [simplify_hull(points)]

    return split(float(height.min()), float(height.max()))
