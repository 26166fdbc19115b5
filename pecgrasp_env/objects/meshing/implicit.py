"""Bodies without edges: signed distances blended into one another, and the mesh of their zero level.

A field is a function of (N, 3) points in mm that returns (N,) distances in mm, negative inside.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

Field = Callable[[np.ndarray], np.ndarray]


def round_cone(start: Sequence[float], end: Sequence[float], start_radius: float, end_radius: float) -> Field:
    """A capsule whose radius changes linearly from one end to the other (a close bound, not the exact distance)."""
    a, b = np.asarray(start, float), np.asarray(end, float)

    def field(p: np.ndarray) -> np.ndarray:
        t = np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        return np.linalg.norm(p - a - t[:, None] * (b - a), axis=1) - (start_radius + t * (end_radius - start_radius))

    return field


def rounded_box(centre: Sequence[float], half: Sequence[float], radius: float) -> Field:
    """A box of the given half sizes (radius included) with all its edges rounded."""
    c, h = np.asarray(centre, float), np.asarray(half, float) - radius

    def field(p: np.ndarray) -> np.ndarray:
        q = np.abs(p - c) - h
        return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - radius

    return field


def ellipsoid(centre: Sequence[float], half: Sequence[float]) -> Field:
    """An ellipsoid; the distance is scaled by its gradient (first order)."""
    c, h = np.asarray(centre, float), np.asarray(half, float)

    def field(p: np.ndarray) -> np.ndarray:
        q = (p - c) / h
        k = np.linalg.norm(q, axis=1)
        return k * (k - 1) / np.maximum(np.linalg.norm(q / h, axis=1), 1e-9)

    return field


def blend(fields: Sequence[Field], radius: float) -> Field:
    """Union with fillets: exponential smooth minimum, symmetric in its members; `radius` mm sets the fillets' size."""

    def field(p: np.ndarray) -> np.ndarray:
        distances = np.stack([f(p) for f in fields])
        least = distances.min(axis=0)
        return least - radius / 4 * np.log(np.exp(-4 / radius * (distances - least)).sum(axis=0))

    return field


def top_of(field: Field, x: float, y: float, highest: float, step: float = 0.25) -> float:
    """Height of the uppermost surface point above (x, y), searched downwards from z = `highest`."""
    z = np.arange(highest, -highest, -step)
    inside = field(np.column_stack([np.full_like(z, x), np.full_like(z, y), z])) < 0
    return float(z[inside.argmax()]) if inside.any() else 0.0


def surface_net(
    field: Field, lower: Sequence[float], upper: Sequence[float], step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Mesh of the zero level inside a box: surface nets (Gibson, 1998), then two Newton steps onto the surface.

    Returns vertices (V, 3) mm and faces (F, 3), outward. The surface must not reach the box's border.
    """
    axes = [np.arange(lo, hi + step, step) for lo, hi in zip(lower, upper, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    value = field(grid.reshape(-1, 3)).reshape([len(a) for a in axes])
    cells = tuple(len(a) - 1 for a in axes)

    def corner(offset: tuple[int, ...]) -> np.ndarray:
        return value[tuple(slice(o, o + n) for o, n in zip(offset, cells, strict=True))]

    # A vertex in each cell whose corners differ in sign: the mean of the crossings on the cell's edges.
    crossing_sum, crossing_count = np.zeros((*cells, 3)), np.zeros(cells)
    for axis in range(3):
        for other in product((0, 1), repeat=2):
            start = list(other)
            start.insert(axis, 0)
            end = list(other)
            end.insert(axis, 1)
            a, b = corner(tuple(start)), corner(tuple(end))
            crosses = (a < 0) != (b < 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                t = np.where(crosses, a / (a - b), 0.0)
            for i in range(3):
                crossing_sum[..., i] += crosses * (t if i == axis else float(start[i]))
            crossing_count += crosses
    active = crossing_count > 0
    index = np.full(cells, -1)
    index[active] = np.arange(active.sum())
    vertices = np.argwhere(active) + crossing_sum[active] / crossing_count[active][:, None]
    vertices = np.asarray(lower, float) + step * vertices
    # A quad around each grid edge that crosses, from the four cells that share it.
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        low = [slice(1, -1)] * 3
        low[axis] = slice(0, -1)
        high = list(low)
        high[axis] = slice(1, None)
        a, b = value[tuple(low)] < 0, value[tuple(high)] < 0
        for leaving, rising in ((a & ~b, True), (~a & b, False)):
            cell = np.argwhere(leaving) + 1
            cell[:, axis] -= 1
            quad = []
            for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
                c = cell.copy()
                c[:, u] -= 1 - du
                c[:, v] -= 1 - dv
                quad.append(index[tuple(c.T)])
            q = np.stack(quad if rising else quad[::-1], axis=1)
            faces += [q[:, [0, 1, 2]], q[:, [0, 2, 3]]]
    for _ in range(2):
        vertices = vertices - _newton_step(field, vertices)
    return vertices, np.concatenate(faces)


def _newton_step(field: Field, points: np.ndarray, h: float = 0.05) -> np.ndarray:
    offsets = h * np.eye(3)
    gradient = np.stack([(field(points + o) - field(points - o)) / (2 * h) for o in offsets], axis=1)
    return field(points)[:, None] * gradient / np.maximum((gradient**2).sum(axis=1, keepdims=True), 1e-6)
