"""Smooth closed surfaces from loops: the few shapes that the robot's visual meshes are made of. Metres, z up.

A loop is (n, 3), n points around; a surface is a stack of loops skinned together and closed by a fan at both ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

AROUND = 48  # points a loop
CREASE = np.radians(32)  # edges sharper than this stay sharp in shading


@dataclass(frozen=True)
class Surface:
    vertices: np.ndarray  # (V, 3)
    faces: np.ndarray  # (F, 3), outwards counter-clockwise

    def moved(self, T: np.ndarray) -> Surface:
        """The surface under a rigid transform (4, 4)."""
        return Surface(self.vertices @ T[:3, :3].T + T[:3, 3], self.faces)


def loft(loops: Sequence[np.ndarray]) -> Surface:
    """Skin a stack of loops (each (n, 3), counter-clockwise seen from the last) and close both ends."""
    n = len(loops[0])
    i = np.arange(n)
    j = (i + 1) % n
    sides = []
    for level in range(len(loops) - 1):
        low, high = level * n, (level + 1) * n
        sides += [np.stack([low + i, low + j, high + j], 1), np.stack([low + i, high + j, high + i], 1)]
    bottom, top = len(loops) * n, len(loops) * n + 1
    last = (len(loops) - 1) * n
    fans = [np.stack([j, i, np.full(n, bottom)], 1), np.stack([last + i, last + j, np.full(n, top)], 1)]
    vertices = np.concatenate([*loops, loops[0].mean(0)[None], loops[-1].mean(0)[None]])
    return Surface(vertices, np.concatenate([*sides, *fans]))


def lathe(profile: Sequence[tuple[float, float]]) -> Surface:
    """Turn (radius, z) points, from bottom to top, about z."""
    angle = np.linspace(0, 2 * np.pi, AROUND, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(AROUND)], 1)
    return loft([ring * radius + [0, 0, z] for radius, z in profile])


def tube(radius: float, low: float, high: float, bevel: float = 0.003) -> Surface:
    """A cylinder about z with rounded edges."""
    turn = np.linspace(0, np.pi / 2, 4)
    inset, rise = bevel * (1 - np.sin(turn)), bevel * (1 - np.cos(turn))
    foot = [(radius - x, low + z) for x, z in zip(inset, rise, strict=True)]
    head = [(radius - x, high - z) for x, z in zip(inset[::-1], rise[::-1], strict=True)]
    return lathe([*foot, *head])


def dome(radius: float, base: float, height: float) -> Surface:
    """A shallow rounded cap about z: a rim of a third of the height, then a flattened dome."""
    turn = np.linspace(0, np.pi / 2, 9)[:-1]
    rim = height / 3
    arc = [(radius * np.cos(t) ** 0.6, base + rim + (height - rim) * np.sin(t)) for t in turn]
    return lathe([(radius, base), *arc])


def outline(circles: Sequence[tuple[float, float, float]], grow: float = 0.0, n: int = AROUND) -> np.ndarray:
    """Convex hull (n, 2) of circles (x, y, radius), by support points: grown outlines match point by point."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False) + np.pi / n
    direction = np.stack([np.cos(angle), np.sin(angle)], 1)
    c = np.asarray(circles, dtype=float)
    best = (direction @ c[:, :2].T + c[:, 2]).argmax(1)
    return c[best, :2] + (c[best, 2] + grow)[:, None] * direction


def plate(circles: Sequence[tuple[float, float, float]], low: float, high: float, bevel: float = 0.0015) -> Surface:
    """The hull of circles (x, y, radius), extruded along z from `low` to `high`, with chamfered edges."""
    levels = [(low, -bevel), (low + bevel, 0.0), (high - bevel, 0.0), (high, -bevel)]
    return loft([np.column_stack([outline(circles, grow), np.full(AROUND, z)]) for z, grow in levels])


def box(size: tuple[float, float], low: float, high: float, corner: float = 0.003) -> Surface:
    """A block of `size` (x, y) about z from `low` to `high` with rounded corners."""
    x, y = size[0] / 2 - corner, size[1] / 2 - corner
    return plate(
        [(x, y, corner), (-x, y, corner), (-x, -y, corner), (x, -y, corner)], low, high, 0.7 * min(corner, 0.003)
    )


def axes(z: ArrayLike, x: ArrayLike, origin: ArrayLike = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Rigid transform (4, 4) that lays local z and x along the given orthogonal axes."""
    T = np.eye(4)
    T[:3, 2] = np.asarray(z) / np.linalg.norm(z)
    T[:3, 0] = np.asarray(x) / np.linalg.norm(x)
    T[:3, 1] = np.cross(T[:3, 2], T[:3, 0])
    T[:3, 3] = origin
    return T


def shaded(surface: Surface) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, normals, faces for rendering: smooth where faces meet gently, split along creases."""
    v, f = surface.vertices, surface.faces
    scaled = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])  # length: twice the area
    area = np.linalg.norm(scaled, axis=1)
    f, scaled, area = f[area > 1e-12], scaled[area > 1e-12], area[area > 1e-12]
    unit = scaled / area[:, None]
    # Vertices at one place are one for shading; pairs of faces that share it average where they meet gently.
    _, place = np.unique(np.round(v, 7), axis=0, return_inverse=True)
    corner_place, corner_face = place.reshape(-1)[f].reshape(-1), np.repeat(np.arange(len(f)), 3)
    normals = np.empty((len(corner_face), 3))
    order = np.argsort(corner_place, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(corner_place[order])) + 1):
        faces = corner_face[group]
        gentle = unit[faces] @ unit[faces].T > np.cos(CREASE)
        normals[group] = gentle @ scaled[faces]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    corners = np.concatenate([v[f.reshape(-1)], normals], axis=1)
    kept, index = np.unique(np.round(corners, 6), axis=0, return_inverse=True)
    return kept[:, :3], kept[:, 3:], index.reshape(-1, 3)
