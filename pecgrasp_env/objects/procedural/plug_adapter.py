"""Plug and travel adapters: a moulded body, pins on one face, a socket (a round recess or slots) in the other."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import (
    Shape,
    block,
    disc,
    inset,
    lathe,
    loft,
    rings,
    skin,
    sleeve,
    superellipse,
    wall_hulls,
)
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import (
    BLACK,
    BLUE,
    BRASS,
    CHARCOAL,
    GREY,
    ORANGE,
    RED,
    STEEL,
    WHITE,
    Color,
    pick,
)

N = 48  # points of a ring; the wall of the recess is made of N / 4 hulls


def plug_adapter(rng: np.random.Generator) -> Draft:
    """Lying on its side: pins towards -x, socket towards +x. Built upright, pins down."""
    half_y, half_z = rng.uniform(23.5, 30), rng.uniform(23.5, 28)
    length = rng.uniform(36, 58)
    face = superellipse(half_y, half_z, rng.choice([2.0, 3.0, 5.0, 7.0]), N)
    foot = rng.uniform(0.78, 1.0)  # the body narrows towards the pins
    color = pick(rng, (WHITE, BLACK, GREY, WHITE, ORANGE, BLUE))
    metal = pick(rng, (STEEL, BRASS))

    def ring(z: float, in_by: float = 0.0) -> np.ndarray:
        return np.column_stack([inset(face * (foot + (1 - foot) * z / length), in_by), np.full(N, z)])

    pieces: list[tuple[Shape, Color]] = []
    lower, upper = (
        [ring(0, 2.2), ring(0.7, 0.7), ring(2.4)],
        [ring(length - 2), ring(length - 0.6, 0.6), ring(length, 2)],
    )
    if rng.random() < 0.6:
        depth = rng.uniform(10, 15)
        floor = length - depth
        radius = min(half_y, half_z) - rng.uniform(3.2, 4.5)
        hole = rings(np.array([(radius, floor), (radius, length - 1.0), (radius + 0.8, length)]), N)
        surface = skin(np.concatenate([lower, [ring(floor)], upper, hole[::-1]]))
        solid = loft(np.array([*lower, ring(floor)]))
        wall = wall_hulls(np.array([ring(floor), upper[-1]]), hole[[0, 2]], N // 4)
        pieces.append((Shape(surface.vertices, surface.faces, solid.hulls + wall), color))
        pieces += [(disc(3.0, 0.5, n=20).without_hulls().moved(y, 0, floor), BLACK) for y in (-9.5, 9.5)]
        clip = block(5, 3.0, depth - 2, 0.8).without_hulls()
        pieces += [(clip.moved(0, side * (radius - 1.2), floor), metal) for side in (-1, 1)]
    else:
        pieces.append((loft(np.array(lower + upper)), color))
        pieces += [(slot.without_hulls().moved(z=length - 0.3), BLACK) for slot in _slots(rng)]
    stripe = np.array([ring(z * length) for z in np.linspace(0.3, 0.3 + rng.uniform(0.05, 0.2), 4)])
    pieces.append((sleeve(stripe, 0.8), pick(rng, [c for c in (CHARCOAL, GREY, RED, BLUE, WHITE) if c != color])))
    pieces += [(pin.rotated("x", 180), metal) for pin in _pins(rng)]
    return [(shape.rotated("y", 90).rotated("x", 90), c) for shape, c in pieces], rng.uniform(0.06, 0.16)


def _pins(rng: np.random.Generator) -> list[Shape]:
    """Pins that stand on z = 0: European round, British, American or Australian."""
    kind = rng.integers(4)
    if kind == 0:
        pin = lathe([(2.4, -2), (2.4, 16), (2.1, 18), (1.2, 19), (0, 19.2)], n=20)
        return [pin.moved(x=-9.5), pin.moved(x=9.5)]
    if kind == 1:
        live = block(6.4, 4.0, 19, 0.5)
        return [block(4.0, 8.0, 24, 0.5).moved(0, 11, -2), live.moved(-11, -11, -2), live.moved(11, -11, -2)]
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
    """The openings of a flat socket, as dark plates: British, or a universal one for round and flat pins."""
    if rng.random() < 0.5:
        side = block(7, 4.5, 0.6, 0.5)
        return [block(4.5, 8.5, 0.6, 0.5).moved(0, 10), side.moved(-11, -8), side.moved(11, -8)]
    hole, slot = disc(2.8, 0.6, n=20), block(2.2, 7.5, 0.6, 0.5)
    return [hole.moved(-9.5, -1), hole.moved(9.5, -1), slot.moved(-6.3, 0.5), slot.moved(6.3, 0.5), hole.moved(0, -12)]
