"""Strangers near the classes, made of the classes' own models: out of proportion, cut off, pressed together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import QhullError
from scipy.spatial.transform import Rotation
from trimesh.intersections import slice_faces_plane

from pecgrasp_env.objects.errors import ObjectError
from pecgrasp_env.objects.meshing.convex_hulls import THINNEST, convex_hull, simplify_hull, thickness
from pecgrasp_env.objects.meshing.mesh_cache import Part
from pecgrasp_env.objects.model import ObjectModel, centre_of_mass

__all__ = ["deformed", "fragment", "fused"]

LONGEST, SHORTEST = 0.34, 0.018  # m, of the longest side


def deformed(model: ObjectModel, rng: np.random.Generator) -> ObjectModel:
    """As no member of the class is: twice as large or a third, or squashed or drawn out along an axis."""
    if rng.random() < 0.45:
        factors = np.full(3, rng.uniform(1.8, 2.6) if rng.random() < 0.5 else rng.uniform(0.22, 0.36))
    else:
        factors = np.ones(3)
        factors[rng.integers(3)] = rng.uniform(0.25, 0.42) if rng.random() < 0.6 else rng.uniform(2.0, 3.0)
    longest = float((model.extents * factors).max())
    if longest > LONGEST or longest < SHORTEST:  # the other way, which then fits
        factors = 1 / factors
        longest = float((model.extents * factors).max())
    factors = factors * np.clip(1.0, SHORTEST / longest, LONGEST / longest)
    return _mapped(model, np.diag(factors))


def fragment(model: ObjectModel, rng: np.random.Generator) -> ObjectModel:
    """What is left of it on one side of a plane: a fifth to two fifths along the plane's normal.

    Of more, or of a member half hidden, a camera could not say which it is.

    The cut is closed by the convex parts' sections.
    """
    points = np.concatenate([p.vertices for p in model.parts]).astype(float)
    for _ in range(20):
        normal = rng.normal(size=3) * [1, 1, 0.6]
        normal /= np.linalg.norm(normal)
        along = points @ normal
        low, high = float(along.min()), float(along.max())
        origin = normal * (high - rng.uniform(0.2, 0.42) * (high - low))
        cut = [_clip(hull.astype(float), normal, origin) for hull in model.hulls]
        hulls = [hull for hull, _ in cut if hull is not None]
        parts = []
        for part in model.parts:
            v, f, *_ = slice_faces_plane(part.vertices.astype(float), part.faces, normal, origin)
            if len(f):
                parts.append(Part(v.astype(np.float32), f.astype(np.int32), part.color))
        caps = [cap for _, cap in cut if cap is not None]
        if hulls and parts:
            parts += [Part(v, f, parts[0].color) for v, f in caps]
            return _model(model, parts, hulls, model.mass * 0.5)
    raise ObjectError(f"{model.class_name}/{model.instance} cannot be cut: it has no volume")


def fused(a: ObjectModel, b: ObjectModel, rng: np.random.Generator) -> ObjectModel:
    """Two that stand on one floor, turned about the vertical, and touch or enter one another a little."""
    turn = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
    b = _mapped(b, turn)
    points_a, points_b = (np.concatenate(m.hulls).astype(float) for m in (a, b))
    angle = rng.uniform(0, 2 * np.pi)
    toward = np.array([np.cos(angle), np.sin(angle), 0.0])
    # Between the axes, not corner to corner: only what lies near the line of the two centres keeps them apart.
    side = np.array([-toward[1], toward[0], 0.0])
    reach_a = (points_a @ toward)[np.abs(points_a @ side) < 0.7 * np.ptp(points_a @ side) / 2 + 1e-9]
    reach_b = (points_b @ toward)[np.abs(points_b @ side) < 0.7 * np.ptp(points_b @ side) / 2 + 1e-9]
    gap = reach_a.max() - reach_b.min() if len(reach_a) and len(reach_b) else 0.0
    offset = toward * (gap - rng.uniform(0.0, 0.015))
    offset[2] = points_a[:, 2].min() - points_b[:, 2].min()
    parts = [*a.parts, *(replace(p, vertices=(p.vertices + offset).astype(np.float32)) for p in b.parts)]
    hulls = [*a.hulls, *((h + offset) for h in b.hulls)]
    return _model(a, parts, hulls, a.mass + b.mass)


def _mapped(model: ObjectModel, matrix: np.ndarray) -> ObjectModel:
    """Its points times the matrix's transpose; the matrix turns nothing inside out."""
    parts = [replace(p, vertices=(p.vertices @ matrix.T).astype(np.float32)) for p in model.parts]
    mass = float(np.clip(model.mass * np.linalg.det(matrix), 0.02, 1.5))
    return _model(model, parts, [h @ matrix.T for h in model.hulls], mass)


def _model(of: ObjectModel, parts: Sequence[Part], hulls: Sequence[np.ndarray], mass: float) -> ObjectModel:
    solid = [np.asarray(h, float) for h in hulls if thickness(np.asarray(h, float) * 1e3) >= THINNEST]
    solid = solid or [np.asarray(h, float) for h in hulls]
    centre = centre_of_mass(solid)
    moved = tuple(replace(p, vertices=(p.vertices - centre).astype(np.float32)) for p in parts)
    return ObjectModel(of.class_name, of.instance, moved, tuple((h - centre).astype(np.float32) for h in solid), mass)


def _clip(
    points: np.ndarray, normal: np.ndarray, origin: np.ndarray
) -> tuple[np.ndarray | None, tuple[np.ndarray, np.ndarray] | None]:
    """What is left of a convex hull on the plane's side of `normal`, and the cap that closes it, if it is cut."""
    height = (points - origin) @ normal
    if height.min() >= 0:
        return points, None
    if height.max() <= 1e-4:
        return None, None
    hull = convex_hull(points)
    height = (hull.points - origin) @ normal
    edges = np.sort(np.concatenate([hull.simplices[:, [0, 1]], hull.simplices[:, [1, 2]], hull.simplices[:, [2, 0]]]))
    edges = np.unique(edges, axis=0)
    crossing = edges[(height[edges[:, 0]] < 0) != (height[edges[:, 1]] < 0)]
    h0, h1 = height[crossing[:, 0]], height[crossing[:, 1]]
    t = (h0 / (h0 - h1))[:, None]
    on_plane = hull.points[crossing[:, 0]] * (1 - t) + hull.points[crossing[:, 1]] * t
    left = np.concatenate([hull.points[np.unique(hull.simplices)][height[np.unique(hull.simplices)] > 0], on_plane])
    try:
        kept = simplify_hull(left * 1e3) * 1e-3
        convex_hull(kept)
    except (QhullError, ValueError):
        return None, None
    middle = on_plane.mean(axis=0)
    u = np.linalg.svd(np.eye(3) - np.outer(normal, normal))[0][:, 0]
    w = np.cross(normal, u)
    order = np.argsort(np.arctan2((on_plane - middle) @ w, (on_plane - middle) @ u))
    vertices = np.concatenate([on_plane[order], [middle]]).astype(np.float32)
    n = len(order)
    # Looks away from what is left.
    faces = np.column_stack([(np.arange(n) + 1) % n, np.arange(n), np.full(n, n)]).astype(np.int32)
    return kept, (vertices, faces)
