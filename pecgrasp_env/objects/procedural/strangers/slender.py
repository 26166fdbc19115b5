"""Strangers that are thin or flat: slabs, bent rods, things with wings. Lengths in mm."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from pecgrasp_env.objects.meshing.shapes import Shape, block, disc, extrude, lathe, rounded_rectangle, tube
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.strangers.common_draws import between, mass_of, paint

__all__ = ["bent_rod", "glider", "slab"]


def _rounded(rng: np.random.Generator, a: float, b: float) -> tuple[np.ndarray, float]:
    """A convex outline about the origin, counter-clockwise: what is stretched round two to five discs in a × b.

    And the radius of the least of them.
    """
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    discs, least = [], np.inf
    for _ in range(int(rng.integers(2, 6))):
        radius = 0.5 * min(a, b) * rng.uniform(0.08, 0.95)
        least = min(least, radius)
        at = rng.uniform(-1, 1, 2) * [a / 2 - radius, b / 2 - radius]
        discs.append(at + radius * np.column_stack([np.cos(turn), np.sin(turn)]))
    points = np.concatenate(discs)
    outline = points[ConvexHull(points).vertices]
    low, high = outline.min(axis=0), outline.max(axis=0)
    return (outline - (low + high) / 2) * ([a, b] / (high - low)), least


def slab(rng: np.random.Generator) -> Draft:
    """A smooth case, nearly nothing on it: telephones, soaps, wallets, tape measures, tins, irons."""
    a, b, c = between(rng, 30, 190), between(rng, 22, 100), between(rng, 5, 55)
    outline, radius = _rounded(rng, a, b)
    if rng.random() < 0.5:  # four corners
        radius = min(a, b) * rng.uniform(0.05, 0.49)
        outline = rounded_rectangle(a, b, radius)
    bevel = min(c / 2.5, 0.7 * radius) * rng.uniform(0.1, 1)
    body = extrude(outline, c, bevel, fit=1.5)
    if rng.random() < 0.35:  # thinner to one end
        slope = rng.uniform(-0.7, 0.7) / a
        wedge = [np.column_stack([p[:, :2], p[:, 2] * (1 + slope * p[:, 0])]) for p in (body.vertices, *body.hulls)]
        body = Shape(wedge[0], body.faces, tuple(wedge[1:]))
    pieces = [(body, paint(rng))]
    if rng.random() < 0.4:
        size = between(rng, 3, 0.3 * min(a, b) + 3)
        x, y = rng.uniform(-0.25, 0.25, 2) * [a, b]
        knob = disc(size, c + rng.uniform(1, 12), 0.5, 20) if rng.random() < 0.5 else block(2 * size, size, c + 3, 1)
        pieces.append((knob.moved(float(x), float(y)), paint(rng)))
    if rng.random() < 0.3:
        pieces = [(shape.rotated("x", 90), color) for shape, color in pieces]
    return pieces, mass_of(rng, a * b * c)


def bent_rod(rng: np.random.Generator) -> Draft:
    """A rod with one to four sharp bends: hex keys, hooks, brackets, hairpins, tent pegs, hangers, cranks, stands."""
    thick = between(rng, 3, 14)
    n = int(rng.integers(1, 5))
    heading, at = 0.0, np.zeros(2)
    corners = [at]
    for i in range(n + 1):
        at = at + between(rng, 3 * thick, 130 if i == 0 else 90) * np.array([np.cos(heading), np.sin(heading)])
        corners.append(at)
        heading += rng.choice([-1, 1]) * (np.pi / 2 if rng.random() < 0.6 else rng.uniform(0.3, 2.4))
    path = [corners[0]]
    for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
        reach = min(1.3 * thick, 0.45 * np.linalg.norm(corner - before), 0.45 * np.linalg.norm(after - corner))
        start = corner - reach * (corner - before) / np.linalg.norm(corner - before)
        end = corner + reach * (after - corner) / np.linalg.norm(after - corner)
        path += [(1 - t) ** 2 * start + 2 * t * (1 - t) * corner + t**2 * end for t in np.linspace(0, 1, 6)]
    path.append(corners[-1])
    line = np.column_stack([np.array(path), np.zeros(len(path))])
    body = tube(line, thick, thick * rng.uniform(0.6, 1.5), exponent=rng.choice([2.0, 6.0]), fit=2.0, n=12)
    pieces = [(body, paint(rng))]
    if rng.random() < 0.35:  # a grip
        grip = lathe([(thick, 0), (1.2 * thick, 5), (thick, between(rng, 30, 90))], 18, fit=1.5).rotated("y", -90)
        pieces.append((grip.moved(x=8), paint(rng)))
    if rng.random() < 0.2:
        pieces = [(shape.rotated("x", 90), color) for shape, color in pieces]
    return pieces, rng.uniform(0.02, 0.4)


def glider(rng: np.random.Generator) -> Draft:
    """A body with pairs of flat wings: aeroplanes, darts, propellers, butterflies, fish, crosses, starfish."""
    length, radius = between(rng, 50, 240), between(rng, 4, 26)
    s = np.linspace(0, 1, 14)
    swell = radius * np.maximum(np.sin(np.pi * np.clip(0.04 + 0.94 * s, 0, 1)) ** between(rng, 0.25, 1), 0.12)
    body = lathe(np.column_stack([swell, length * s]), 22, rng.uniform(0.6, 1), 1.5).rotated("y", 90)
    color, other = paint(rng), paint(rng)
    pieces = [(body, color)]
    chord, span = length * rng.uniform(0.12, 0.45), length * between(rng, 0.2, 0.65)
    spots = [rng.uniform(0.3, 0.6), rng.uniform(0.75, 0.95)][: int(rng.integers(1, 3))]
    for number, spot in enumerate(spots):
        size, sweep = 0.55**number, rng.uniform(-0.3, 0.5) * chord
        tip, thick = chord * rng.uniform(0.25, 1), between(rng, 2.5, 10) * size + 1.5
        outline = np.array([(-chord / 2, 0), (chord / 2, 0), (sweep + tip / 2, span), (sweep - tip / 2, span)]) * size
        wing = extrude(outline, thick).moved(x=spot * length, z=-thick / 2)
        lift = rng.uniform(-20, 20) * (rng.random() < 0.5)
        pieces += [(wing.rotated("x", lift), other), (wing.scaled(y=-1).rotated("x", -lift), other)]
        if number == 1 and rng.random() < 0.7:  # a fin
            pieces.append((wing.rotated("x", 90).scaled(z=0.7), other))
    return pieces, rng.uniform(0.03, 0.3)
