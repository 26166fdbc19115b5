"""Strangers without edges, or with cuts: signed distances united, cut and blended. Lengths in mm."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from pecgrasp_env.objects.meshing.convex_decomposition import halved
from pecgrasp_env.objects.meshing.convex_hulls import simplify_hull
from pecgrasp_env.objects.meshing.implicit import Field, blend, ellipsoid, round_cone, rounded_box, surface_net
from pecgrasp_env.objects.meshing.shapes import Shape
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.strangers.common_draws import between, mass_of, paint

__all__ = ["carved", "compound", "fruit", "knobbly", "letter", "toy"]

_CELLS = 300_000  # of a grid, at most: a quarter of a second


def cut_out(solid: Field, hole: Field) -> Field:
    """`solid` without `hole`."""
    return lambda p: np.maximum(solid(p), -hole(p))


def mesh_of(field: Field, reach: Sequence[float] | np.ndarray, thinnest: float = 6.0) -> Shape:
    """The zero level of a field within ± reach mm of the origin, and the convex parts of it.

    Cells are a third of what is `thinnest`, or as large as keeps them few.
    """
    half = np.asarray(reach, float) + 4
    step = max(thinnest / 3, float((8 * half.prod() / _CELLS) ** (1 / 3)))
    lower = -half - step * 0.37  # off the symmetry planes, where a field would be zero at whole rows of corners
    vertices, faces = _largest(*surface_net(field, lower.tolist(), (half + step).tolist(), step))
    return Shape(vertices, faces, tuple(simplify_hull(hull) for hull in halved(vertices, faces)))


def _largest(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of pieces that do not hang together the one with the most faces."""
    ends = np.concatenate([faces[:, :2], faces[:, 1:]]).T
    joined = coo_array((np.ones(ends.shape[1]), (ends[0], ends[1])), shape=(len(vertices),) * 2)
    piece = connected_components(joined, directed=False)[1][faces[:, 0]]
    kept = faces[piece == np.bincount(piece).argmax()]
    used, index = np.unique(kept, return_inverse=True)
    return vertices[used], index.reshape(-1, 3)


def _turned(field: Field, rotation: np.ndarray, offset: np.ndarray) -> Field:
    return lambda p: field((p - offset) @ rotation)


def _any_rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, ::-1]


def _member(rng: np.random.Generator, size: float) -> Field:
    half = size * np.array([rng.uniform(0.3, 1), rng.uniform(0.25, 0.8), rng.uniform(0.2, 0.6)])
    kind = rng.integers(3)
    if kind == 0:
        return ellipsoid((0, 0, 0), half.tolist())
    if kind == 1:
        return rounded_box((0, 0, 0), half.tolist(), float(half.min()) * rng.uniform(0.1, 0.9))
    a, b = half[1] * rng.uniform(0.3, 1), half[1] * rng.uniform(0.3, 1)
    return round_cone((-half[0] + a, 0, 0), (half[0] - b + 1, 0, 0), a, b)


def compound(rng: np.random.Generator) -> Draft:
    """Two to five bodies in any pose, blended, now and then with a hole: no thing at all."""
    size = between(rng, 18, 75)
    members = []
    for i in range(int(rng.integers(2, 6))):
        offset = rng.uniform(-1, 1, 3) * size * [0.9, 0.7, 0.4] * (i > 0)
        rotation = _any_rotation(rng) if rng.random() < 0.6 else np.eye(3)
        members.append(_turned(_member(rng, size), rotation, offset))
    field = blend(members, between(rng, 2, 0.4 * size))
    if rng.random() < 0.35:
        hole = _turned(_member(rng, 0.6 * size), _any_rotation(rng), rng.uniform(-0.7, 0.7, 3) * size)
        field = cut_out(field, hole)
    shape = mesh_of(field, (2.1 * size, 1.9 * size, 1.6 * size), 0.25 * size)
    return [(shape, paint(rng))], mass_of(rng, 2 * size**3)


def toy(rng: np.random.Generator) -> Draft:
    """A body, a head, limbs: dolls, animals, dinosaurs, figures, gloves, planes."""
    body, long = between(rng, 12, 38), rng.uniform(0.8, 2.2)
    members = [ellipsoid((0, 0, 0), (body * long, body * rng.uniform(0.6, 1), body * rng.uniform(0.6, 1)))]
    head = body * rng.uniform(0.35, 0.9)
    at = np.array([body * long * rng.uniform(0.8, 1.3), 0, body * rng.uniform(-0.2, 1.2)])
    members.append(ellipsoid(at.tolist(), (head * rng.uniform(0.9, 1.5), head, head)))
    members.append(round_cone((0.5 * body * long, 0, 0.2 * body), at.tolist(), 0.5 * body, 0.5 * head))
    for x in np.linspace(-0.75, 0.75, int(rng.choice([1, 2, 2, 3]))) * body * long:
        reach = body * rng.uniform(0.5, 1.6)
        down, thick = rng.uniform(-1, 1), body * rng.uniform(0.15, 0.4)
        for side in (-1, 1):
            end = (
                x + rng.uniform(-0.3, 0.3) * reach,
                side * (0.5 * body + reach * (1 - 0.6 * abs(down))),
                down * reach,
            )
            members.append(round_cone((x, side * 0.4 * body, 0), end, thick, thick * rng.uniform(0.6, 1.3)))
    if rng.random() < 0.5:  # a tail
        end = (-body * long * rng.uniform(1.2, 2.2), 0, body * rng.uniform(-0.4, 1))
        members.append(round_cone((-0.7 * body * long, 0, 0), end, 0.3 * body, 0.12 * body + 1))
    bounds = (2.6 * body * long + 2 * head, 3 * body, 3 * body)
    return [(mesh_of(blend(members, 0.25 * body), bounds, 0.3 * body), paint(rng))], mass_of(rng, 5 * body**3 * long)


def letter(rng: np.random.Generator) -> Draft:
    """Strokes in a plane, raised: letters, digits, brackets, jigsaw pieces, stencils, keys, spectacles, hangers."""
    size, thick, high = between(rng, 22, 95), between(rng, 5, 26), between(rng, 5, 45)
    thick = min(thick, 0.4 * size)
    corners = rng.uniform(-1, 1, (int(rng.integers(3, 6)), 2)) * size * [1, rng.uniform(0.4, 1)]
    if rng.random() < 0.5:  # upright and level strokes only
        corners[1::2, 0] = corners[:-1:2, 0][: len(corners[1::2])]
        corners[2::2, 1] = corners[1:-1:2, 1][: len(corners[2::2])]
    strokes = list(pairwise(corners))
    if rng.random() < 0.4:
        strokes.append((corners[0], corners[-1]))
    loop = rng.random() < 0.4
    centre, radius = rng.uniform(-0.4, 0.4, 2) * size, size * rng.uniform(0.3, 0.6)
    round_ = rng.uniform(0.5, 2.5)

    def field(p: np.ndarray) -> np.ndarray:
        flat = np.full(len(p), np.inf)
        for a, b in strokes:
            along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-6)
            t = np.clip((p[:, :2] - a) @ along, 0, np.linalg.norm(b - a))
            flat = np.minimum(flat, np.linalg.norm(p[:, :2] - a - t[:, None] * along, axis=1) - thick / 2)
        if loop:
            away = np.abs(np.linalg.norm(p[:, :2] - centre, axis=1) - radius) - thick / 2
            flat = np.minimum(flat, away)
        q = np.stack([flat, np.abs(p[:, 2]) - high / 2], axis=1) + round_
        return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - round_

    reach = (1.3 * size + thick, 1.3 * size + thick, high / 2)
    shape = mesh_of(field, reach, min(thick, high))
    if rng.random() < 0.25:
        shape = shape.rotated("x", 90)
    return [(shape, paint(rng))], mass_of(rng, 2.5 * size * thick * high)


def fruit(rng: np.random.Generator) -> Draft:
    """A ball with a hollow, a neck, a stalk or lobes: apples, pears, peppers, lemons, pumpkins, figs, mushrooms."""
    radius, tall = between(rng, 14, 60), between(rng, 0.6, 1.6)
    lobes, depth = int(rng.integers(3, 9)), rng.uniform(0, 0.12) * (rng.random() < 0.5)
    dip, neck = rng.uniform(0, 0.35) * (rng.random() < 0.6), rng.uniform(0, 0.5) * (rng.random() < 0.4)
    stalk = rng.random() < 0.5
    stem = round_cone((0, 0, 0.5 * radius * tall), (rng.uniform(-5, 5), 0, radius * tall * 1.3), 3, 2.5)

    def field(p: np.ndarray) -> np.ndarray:
        angle = np.arctan2(p[:, 1], p[:, 0])
        level = p[:, 2] / (radius * tall)
        wide = radius * (1 - depth * (1 + np.cos(lobes * angle))) * (1 - neck * np.clip(level, -0.3, 1))
        q = p / np.stack([wide, wide, np.full(len(p), radius * tall)], axis=1)
        across = np.hypot(q[:, 0], q[:, 1])
        d = (np.linalg.norm(q, axis=1) - 1 + dip * np.exp(-((across / 0.35) ** 2)) * (level > 0)) * radius * 0.6
        return np.minimum(d, stem(p)) if stalk else d

    reach = (1.6 * radius, 1.6 * radius, 1.4 * radius * tall + 4)
    shape = mesh_of(field, reach, 7.0 if stalk else 0.3 * radius)
    if rng.random() < 0.4:
        shape = shape.rotated("y", float(rng.uniform(60, 120)))
    return [(shape, paint(rng))], mass_of(rng, 4 * radius**3 * tall)


def knobbly(rng: np.random.Generator) -> Draft:
    """A body with a rough skin: crumpled paper, potatoes, ginger, stones, socks, sponges, bags, bread."""
    half = np.array([between(rng, 20, 105), between(rng, 16, 70), between(rng, 10, 50)])
    box = rng.random() < 0.3
    base = (
        rounded_box((0, 0, 0), half.tolist(), 0.6 * float(half.min())) if box else ellipsoid((0, 0, 0), half.tolist())
    )
    waves = rng.normal(size=(int(rng.integers(3, 9)), 3)) / (half * rng.uniform(0.3, 0.9))
    phase, strength = rng.uniform(0, 2 * np.pi, len(waves)), float(half.min()) * rng.uniform(0.04, 0.22)

    def field(p: np.ndarray) -> np.ndarray:
        return base(p) + strength * np.sin(p @ waves.T + phase).mean(axis=1) * 1.8

    shape = mesh_of(field, half * 1.5 + 5, 0.3 * float(half.min()))
    return [(shape, paint(rng))], mass_of(rng, 4 * half.prod())


def carved(rng: np.random.Generator) -> Draft:
    """A block or a drum with holes, notches and hollows: soap dishes, bricks, pencil sharpeners, clock cases, dice."""
    half = np.array([between(rng, 18, 100), between(rng, 15, 70), between(rng, 8, 55)])
    small = float(half.min())
    body = rounded_box((0, 0, 0), half.tolist(), small * rng.uniform(0.1, 0.8))
    if rng.random() < 0.3:
        half[1] = half[0]
        drum, flat = round_cone((0, 0, -1), (0, 0, 1), half[0], half[0]), rounded_box((0, 0, 0), half.tolist(), 1.0)
        body = lambda p: np.maximum(drum(p * [1, 1, 0.01]), flat(p))  # noqa: E731
    for _ in range(int(rng.integers(1, 5))):
        size = half * rng.uniform(0.2, 0.75, 3)
        kind = rng.integers(3)
        if kind == 0:  # from above
            hole = rounded_box((*rng.uniform(-0.5, 0.5, 2) * half[:2], half[2]), size.tolist(), 0.3 * float(size.min()))
        elif kind == 1:  # right through
            through = np.eye(3)[int(rng.integers(3))] * 300
            at = rng.uniform(-0.5, 0.5, 3) * half
            radius = float(size.min()) * 0.8
            hole = round_cone((at - through).tolist(), (at + through).tolist(), radius, radius)
        else:  # off an edge
            hole = rounded_box((np.sign(rng.uniform(-1, 1, 3)) * half).tolist(), size.tolist(), 0.2 * float(size.min()))
        body = cut_out(body, hole)
    return [(mesh_of(body, half, 0.3 * small), paint(rng))], mass_of(rng, 5 * half.prod())
