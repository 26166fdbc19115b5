"""Plug and travel adapters: a moulded body, pins on one face, a socket (a round recess or slots) in the other."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.colors import BLACK, BLUE, BRASS, CHARCOAL, GREY, ORANGE, RED, STEEL, WHITE, Color, pick
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.shapes import Shape, block, disc, inset, lathe, loft, rings, skin, superellipse, wall_hulls

N = 48  # points of a ring; the wall of the recess is made of N / 4 hulls


def plug_adapter(rng: np.random.Generator) -> Draft:
    """Lying on its side: pins towards -x, socket towards +x."""
    half_y, half_z = rng.uniform(23.5, 30), rng.uniform(23.5, 28)
    length = rng.uniform(36, 58)
    exponent = rng.choice([2.0, 3.0, 5.0, 7.0])
    color = pick(rng, (WHITE, BLACK, GREY, WHITE, ORANGE, BLUE))
    metal = pick(rng, (STEEL, BRASS))
    foot = rng.uniform(0.78, 1.0)  # the body narrows towards the pins
    recessed = rng.random() < 0.6
    depth = rng.uniform(10, 15) if recessed else 0.0

    face = superellipse(half_y, half_z, exponent, N)
    levels = [
        (0, 2.2),
        (0.7, 0.7),
        (2.4, 0),
        (length - depth - 4, 0),
        (length - depth, 0),
        (length - 2, 0),
        (length - 0.6, 0.6),
        (length, 2.0),
    ]
    outer = []
    for z, in_by in levels:
        scale = foot + (1 - foot) * min(1.0, z / (0.55 * length))
        outer.append(np.column_stack([inset(face * scale, in_by), np.full(N, z)]))
    outer_rings = np.array(outer)
    pieces: list[tuple[Shape, Color]] = []
    if recessed:
        radius = min(half_y, half_z) - rng.uniform(3.2, 4.5)
        hole = rings(np.array([(radius + 0.8, length), (radius, length - 1.0), (radius, length - depth)]), N)
        body = skin(np.concatenate([outer_rings, hole]))
        solid = loft(outer_rings[:5])
        wall = wall_hulls(outer_rings[[4, 7]] * [1, 1, 1], hole[[2, 0]], N // 4)
        pieces.append((Shape(body.vertices, body.faces, solid.hulls + wall), color))
        floor = length - depth
        for y in (-9.5, 9.5):
            pieces.append((disc(3.0, 0.5, n=20).without_hulls().moved(y, 0, floor), BLACK))
        for z in (-1, 1):
            pieces.append((block(5, 3.0, depth - 2, 0.8).without_hulls().moved(0, z * (radius - 1.2), floor), metal))
    else:
        pieces.append((loft(outer_rings), color))
        pieces += [(slot.without_hulls().moved(z=length - 0.3), BLACK) for slot in _slots(rng)]
    band = np.array(
        [
            np.column_stack([inset(face * (foot + (1 - foot) * min(1.0, z / (0.55 * length))), -0.35), np.full(N, z)])
            for z in (0.32 * length, 0.38 * length)
        ]
    )
    pieces.append((skin(band), pick(rng, (CHARCOAL, GREY, RED, BLUE))))
    pieces += [(pin.rotated("x", 180), metal) for pin in _pins(rng)]
    return [(shape.rotated("y", 90).rotated("x", 90), c) for shape, c in pieces], rng.uniform(0.06, 0.16)


def _pins(rng: np.random.Generator) -> list[Shape]:
    """Pins that stand on z = 0: European round, British, American or Australian."""
    kind = rng.integers(4)
    if kind == 0:
        pin = lathe([(2.4, -2), (2.4, 16), (2.1, 18), (1.2, 19), (0, 19.2)], n=20)
        return [pin.moved(x=-9.5), pin.moved(x=9.5)]
    if kind == 1:
        return [
            block(4.0, 8.0, 24, 0.5).moved(0, 11, -2),
            *(block(6.4, 4.0, 19, 0.5).moved(x, -11, -2) for x in (-11, 11)),
        ]
    if kind == 2:
        ground = lathe([(2.4, -2), (2.4, 17), (1.2, 19.5), (0, 19.7)], n=20).moved(0, 11.9)
        return [block(1.6, 6.4, 19, 0.4).moved(x, 0, -2) for x in (-6.3, 6.3)] + [ground]
    blade = block(1.7, 6.4, 19, 0.4)
    return [
        blade.rotated("z", -30).moved(-7.9, 4, -2),
        blade.rotated("z", 30).moved(7.9, 4, -2),
        block(1.7, 6.4, 22, 0.4).moved(0, -10.3, -2),
    ]


def _slots(rng: np.random.Generator) -> list[Shape]:
    """The openings of a flat socket, as dark plates."""
    if rng.random() < 0.5:
        return [block(4.5, 8.5, 0.6, 0.5).moved(0, 10), *(block(7, 4.5, 0.6, 0.5).moved(x, -8) for x in (-11, 11))]
    return [disc(3.0, 0.6, n=20).moved(x=x) for x in (-9.5, 9.5)] + [disc(16, 0.45, n=40)]
