"""Shape builders: loft, tube, lathe, extrusion, rounded box. Each is a closed mesh and the hulls that fit it.

Lengths are millimetres here and in the generators; `model.assemble` turns them into metres, once. A section (or ring)
is a closed curve of K points; a loft joins consecutive sections with the same K.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects.meshing.convex_hulls import group_sections, simplify_hull

FIT = 0.8  # mm, how far a hull may stand off the surface of a loft


@dataclass(frozen=True, eq=False)
class Shape:
    """A surface and the convex pieces that stand for it in the physics. Lengths in mm."""

    vertices: np.ndarray  # (V, 3)
    faces: np.ndarray  # (F, 3), counter-clockwise seen from outside
    hulls: tuple[np.ndarray, ...] = ()  # each (K, 3)

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Shape:
        return self._mapped(np.eye(3), np.array([x, y, z]))

    def rotated(self, axis: str, degrees: float) -> Shape:
        """Turned about a coordinate axis ("x", "y" or "z") through the origin, right-handed."""
        return self._mapped(Rotation.from_euler(axis, degrees, degrees=True).as_matrix(), np.zeros(3))

    def scaled(self, x: float = 1.0, y: float = 1.0, z: float = 1.0) -> Shape:
        """Stretched about the origin; a negative factor mirrors."""
        return self._mapped(np.diag([x, y, z]), np.zeros(3))

    def without_hulls(self) -> Shape:
        """Only to be seen: a label, a seam, a button that barely stands out."""
        return replace(self, hulls=())

    def _mapped(self, matrix: np.ndarray, offset: np.ndarray) -> Shape:
        faces = self.faces if np.linalg.det(matrix) > 0 else self.faces[:, ::-1]
        return Shape(self.vertices @ matrix.T + offset, faces, tuple(h @ matrix.T + offset for h in self.hulls))


def join(shapes: Sequence[Shape]) -> Shape:
    """Several shapes as one, unblended."""
    starts = np.cumsum([0] + [len(s.vertices) for s in shapes[:-1]])
    return Shape(
        np.concatenate([s.vertices for s in shapes]),
        np.concatenate([s.faces + start for s, start in zip(shapes, starts, strict=True)]),
        tuple(h for s in shapes for h in s.hulls),
    )


# --- curves -----------------------------------------------------------------------------------------------------------


def superellipse(half_x: float, half_y: float, exponent: float = 2.0, n: int = 32) -> np.ndarray:
    """|x/half_x|^p + |y/half_y|^p = 1 as (n, 2) points, counter-clockwise: p = 2 ellipse, p = 5 rounded rectangle."""
    angle = (np.arange(n) + 0.5) / n * 2 * np.pi
    c, s = np.cos(angle), np.sin(angle)
    radius = (np.abs(c) ** exponent + np.abs(s) ** exponent) ** (-1 / exponent)
    return np.stack([half_x * radius * c, half_y * radius * s], axis=1)


def rounded_rectangle(size_x: float, size_y: float, radius: float, per_corner: int = 6) -> np.ndarray:
    """Rectangle with circular corners, (4 * per_corner, 2), counter-clockwise."""
    angle = np.linspace(0, np.pi / 2, per_corner)
    arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = []
    for sx, sy, turn in ((1, 1, 0), (-1, 1, 1), (-1, -1, 2), (1, -1, 3)):
        c, s = np.cos(turn * np.pi / 2), np.sin(turn * np.pi / 2)
        points.append(arc @ np.array([[c, s], [-s, c]]) + [sx * (size_x / 2 - radius), sy * (size_y / 2 - radius)])
    return np.concatenate(points)


def smooth_path(points: Sequence[Sequence[float]], n: int = 24) -> np.ndarray:
    """Natural cubic spline through the given (P, 3) points, n samples evenly spaced in chord length."""
    knots = np.asarray(points, float)
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(knots, axis=0), axis=1))])
    return CubicSpline(s, knots, bc_type="natural")(np.linspace(0, s[-1], n))


def inset(outline: np.ndarray, distance: float) -> np.ndarray:
    """A closed counter-clockwise (K, 2) outline moved inwards; for distances well under its radii of curvature."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    normals = []
    for edge in (before, after):
        length = np.maximum(np.linalg.norm(edge, axis=1, keepdims=True), 1e-12)
        normals.append(np.stack([-edge[:, 1], edge[:, 0]], axis=1) / length)
    middle = normals[0] + normals[1]
    # A mitre: the corner moves further than its edges do.
    return outline + distance * 2 * middle / np.maximum((middle**2).sum(axis=1, keepdims=True), 0.5)


# --- solids -----------------------------------------------------------------------------------------------------------


def skin(sections: np.ndarray, loop: bool = False) -> Shape:
    """The surface over (S, K, 3) sections, closed by fans at both ends (or on itself, `loop`); no hulls."""
    n_sections, k = sections.shape[:2]
    index = np.arange(n_sections * k).reshape(n_sections, k)
    lower, upper = (index, np.roll(index, -1, axis=0)) if loop else (index[:-1], index[1:])
    a, b = lower, np.roll(lower, -1, axis=1)
    c, d = np.roll(upper, -1, axis=1), upper
    faces = [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    vertices = sections.reshape(-1, 3)
    if not loop:
        vertices = np.concatenate([vertices, sections[[0, -1]].mean(axis=1)])
        for ring, centre, flip in ((index[0], len(vertices) - 2, True), (index[-1], len(vertices) - 1, False)):
            fan = np.stack([ring, np.roll(ring, -1), np.full(k, centre)], axis=-1)
            faces.append(fan[:, ::-1] if flip else fan)
    triangles = np.concatenate(faces)
    p, q, r = (vertices[triangles[:, i]] for i in range(3))
    normal = np.cross(q - p, r - p)
    triangles = triangles[np.linalg.norm(normal, axis=1) > 1e-7]
    if np.einsum("ij,ij->", p, normal) < 0:  # the sections ran the other way round
        triangles = triangles[:, ::-1]
    return Shape(vertices, triangles)


def sleeve(sections: np.ndarray, thickness: float = 0.4) -> Shape:
    """A thin open band around (S, K, 3) sections about z, standing half its thickness off them: a label. No hulls."""
    middle = sections.mean(axis=1, keepdims=True)
    outward = (sections - middle) / np.linalg.norm(sections - middle, axis=2, keepdims=True)
    outer, inner = sections + outward * thickness / 2, sections - outward * thickness / 2
    return skin(np.concatenate([outer, inner[::-1]]), loop=True)


def loft(sections: np.ndarray, fit: float = FIT) -> Shape:
    """The solid over (S, K, 3) sections, each of them convex. Hulls: runs of sections within `fit` mm."""
    sections = np.asarray(sections, float)
    return replace(skin(sections), hulls=tuple(group_sections(sections, fit)))


def tube(
    path: np.ndarray,
    width: float | np.ndarray,
    height: float | np.ndarray,
    *,
    exponent: float = 2.0,
    up: Sequence[float] = (0, 0, 1),
    round_ends: float = 0.0,
    n: int = 24,
    fit: float = FIT,
) -> Shape:
    """A superelliptic section swept along a path (S, 3) that lies across `up`.

    width is across the path and `up`, height along `up` (full sizes, one number or S of them). `round_ends` is the
    length in mm over which each end is rounded off; 0 cuts it flat.
    """
    path = np.asarray(path, float)
    w, h = (np.broadcast_to(np.asarray(size, float), len(path)) for size in (width, height))
    if round_ends > 0:
        path, w, h = _rounded_ends(path, w, h, round_ends)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(np.asarray(up, float), tangent)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    vertical = np.cross(tangent, side)
    unit = superellipse(0.5, 0.5, exponent, n)
    sections = (
        path[:, None]
        + unit[None, :, :1] * (w[:, None] * side)[:, None]
        + unit[None, :, 1:] * (h[:, None] * vertical)[:, None]
    )
    return loft(sections, fit)


def _rounded_ends(path, w, h, length):
    """Sample the path again with extra stations near its ends, where the section shrinks as a quarter circle."""
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    length = min(length, s[-1] / 2)
    ramp = length * (1 - np.cos(np.linspace(0.12, np.pi / 2, 5)))
    inner = s[(s > length * 1.1) & (s < s[-1] - length * 1.1)]
    stations = np.concatenate([ramp, inner, (s[-1] - ramp)[::-1]])
    edge = np.minimum(np.minimum(stations, s[-1] - stations), length)
    shrink = np.sqrt(np.maximum(1 - (1 - edge / length) ** 2, 0.0))
    return (
        np.stack([np.interp(stations, s, path[:, i]) for i in range(3)], axis=1),
        np.interp(stations, s, w) * shrink,
        np.interp(stations, s, h) * shrink,
    )


def rings(profile: np.ndarray, n: int = 40, flatten: float = 1.0) -> np.ndarray:
    """Circles about z for a profile (S, 2) of (radius, z): (S, n, 3). `flatten` scales y, for oval bodies."""
    profile = np.asarray(profile, float)
    circle = superellipse(1.0, flatten, 2.0, n)
    flat = profile[:, 0, None, None] * circle[None]
    return np.concatenate([flat, np.broadcast_to(profile[:, 1, None, None], (*flat.shape[:2], 1))], axis=2)


def lathe(
    profile: Sequence[Sequence[float]] | np.ndarray, n: int = 40, flatten: float = 1.0, fit: float = FIT
) -> Shape:
    """A solid of revolution about z; profile: (radius, z) pairs from one end to the other."""
    return loft(rings(np.asarray(profile, float), n, flatten), fit)


def extrude(outline: np.ndarray, height: float, bevel: float = 0.0, fit: float = FIT) -> Shape:
    """A convex (K, 2) outline raised from z = 0 to `height`, its edges rounded with radius `bevel`."""
    steps = np.linspace(0, np.pi / 2, 4) if bevel > 0 else np.array([np.pi / 2])
    low = [(bevel * (1 - np.sin(t)), bevel * (1 - np.cos(t))) for t in steps]
    levels = low + [(d, height - z) for d, z in reversed(low)]
    sections = [np.column_stack([inset(outline, d), np.full(len(outline), z)]) for d, z in levels]
    return loft(np.array(sections), fit)


def block(size_x: float, size_y: float, size_z: float, radius: float = 1.0, bevel: float | None = None) -> Shape:
    """A box standing on z = 0, centred in x and y; upright edges rounded by `radius`, the others by `bevel`."""
    outline = rounded_rectangle(size_x, size_y, radius)
    return extrude(outline, size_z, min(radius, size_z / 2.5) * 0.9 if bevel is None else bevel)


def disc(radius: float, height: float, bevel: float = 0.0, n: int = 32) -> Shape:
    """A cylinder standing on z = 0 about the z axis."""
    return extrude(superellipse(radius, radius, 2.0, n), height, bevel)


def wall_hulls(outer: np.ndarray, inner: np.ndarray, sectors: int) -> tuple[np.ndarray, ...]:
    """Convex pieces of a hollow wall: one a sector and a pair of levels.

    outer, inner: (L, K, 3) rings at the same L levels, K a multiple of `sectors`.
    """
    k = outer.shape[1]
    step = k // sectors
    hulls = []
    for level in range(len(outer) - 1):
        for sector in range(sectors):
            columns = np.arange(sector * step, (sector + 1) * step + 1) % k
            points = np.concatenate([outer[level : level + 2, columns], inner[level : level + 2, columns]])
            hulls.append(simplify_hull(points.reshape(-1, 3)))
    return tuple(hulls)
