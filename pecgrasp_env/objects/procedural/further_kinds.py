"""Kinds of products that the classes' own generators do not draw: for the wide families alone. Millimetres."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import Shape, block, disc, smooth_path, tube
from pecgrasp_env.objects.model import Color, Draft
from pecgrasp_env.objects.procedural.colors import (
    BLACK,
    BLUE,
    BRIGHT,
    CHARCOAL,
    CREAM,
    NAVY,
    ORANGE,
    RED,
    STEEL,
    WHITE,
    pick,
)
from pecgrasp_env.objects.procedural.vessels import vessel

__all__ = ["oval_tin", "ramekin", "screw_clamp"]


def screw_clamp(rng: np.random.Generator) -> Draft:
    """A C or F clamp, lying flat: a frame, a screw through its lower arm with a pad, a handle across the screw."""
    reach, opening = rng.uniform(40, 70), rng.uniform(50, 130)
    thick, broad = rng.uniform(8, 13), rng.uniform(9, 18)
    corner = rng.choice([2.0, 14.0])  # cast frames are round, rails are not
    knots = [(reach, opening, 0), (corner, opening + 0.3 * corner, 0), (0, opening - corner, 0), (0, corner, 0)]
    knots += [(corner, -0.3 * corner, 0), (reach, 0, 0)]
    frame = tube(smooth_path(knots, 36), broad, thick, exponent=5)
    driven = rng.uniform(0.15, 0.7) * opening
    screw = disc(rng.uniform(3.5, 6), driven + 45, 0.8, n=16).rotated("x", -90).moved(reach - 4, -45, 0)
    pad = disc(rng.uniform(7, 11), 6, 1.0, n=20).rotated("x", -90).moved(reach - 4, driven, 0)
    color = pick(rng, (RED, BLUE, ORANGE, BLACK, CHARCOAL, STEEL))
    pieces: list[tuple[Shape, Color]] = [(frame, color), (screw, STEEL), (pad, STEEL)]
    if rng.random() < 0.5:  # a bar to turn it by, or a round grip
        bar = disc(2.8, 48, 0.8, n=12).rotated("y", 90).moved(reach - 28, -42, 0)
        pieces.append((bar, STEEL))
    else:
        grip = disc(rng.uniform(9, 14), 55, 3.0, n=20).rotated("x", 90).moved(reach - 4, -35, 0)
        pieces.append((grip, color))
    return pieces, rng.uniform(0.12, 0.5)


def oval_tin(rng: np.random.Generator) -> Draft:
    """A fish tin: flat, with rounded corners, and a ring to pull."""
    a, b, c = rng.uniform(95, 155), rng.uniform(55, 90), rng.uniform(20, 38)
    color = pick(rng, (STEEL, RED, BLUE, ORANGE))
    tin = block(a, b, c, min(rng.uniform(14, 30), 0.45 * b), 1.5)
    ring = disc(9, 1.4, 0.4, n=20).without_hulls().moved(0.3 * a, 0, c)
    return [(tin, color), (ring, STEEL)], a * b * c * 1e-6 * rng.uniform(0.7, 1.0)


def ramekin(rng: np.random.Generator) -> Draft:
    """A small baking dish: its wall stands upright, or nearly."""
    radius, height = rng.uniform(38, 58), rng.uniform(32, 58)
    wall, floor = rng.uniform(3.5, 5.5), rng.uniform(5, 8)
    lean = rng.uniform(0.84, 0.99)  # radius of the foot over that of the rim
    z = np.linspace(1.5, height - 1, 9)
    outer = np.column_stack([radius * (lean + (1 - lean) * z / height), z])
    if rng.random() < 0.6:  # a rim that stands out
        outer[-2:, 0] += 1.6
    outside = np.concatenate([[[outer[0, 0] - 2.0, 0.0]], outer])
    color = pick(rng, (WHITE, CREAM, NAVY, *BRIGHT))
    return [(vessel(outside, wall, floor, sectors=14, levels=2), color)], rng.uniform(0.12, 0.35)
