"""Cans and cartons."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import block, disc, lathe
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BLACK, BRIGHT, CARDBOARD, CREAM, NAVY, STEEL, WHITE, pick


def can(rng: np.random.Generator) -> Draft:
    """Standing on its end: a tall drink can with a neck, a soup can with a beaded wall, or a flat fish can."""
    kind = rng.integers(3)
    label = pick(rng, (*BRIGHT, NAVY, WHITE, BLACK))
    if kind == 0:
        r, h = rng.uniform(26, 33.5), rng.uniform(115, 150)
        neck = r - rng.uniform(5, 7)
        ends = [(neck - 2, 0), (neck, 0.6), (r - 1.5, 7), (r, 10)]
        top = [
            (r, h - 15),
            (r - 0.8, h - 12),
            (neck, h - 4),
            (neck + 1.2, h - 2),
            (neck + 1.2, h),
            (neck - 0.8, h),
            (neck - 1.2, h - 1.8),
            (0, h - 1.8),
        ]
        pieces = [(lathe([*ends, *top]), STEEL), (lathe([(r + 0.15, 11), (r + 0.15, h - 16)]).without_hulls(), label)]
        tab = block(22, 13, 1.4, 5).without_hulls().moved(4, 0, h - 2.0)
        pieces.append((tab, STEEL))
        return pieces, rng.uniform(0.25, 0.37)
    if kind == 1:
        r, h = rng.uniform(32, 43), rng.uniform(95, 125)
    else:
        r, h = rng.uniform(38, 46), rng.uniform(30, 45)
    rim = [(r - 3, 0), (r + 0.9, 0), (r + 0.9, 2.2), (r, 3.2)]
    profile = rim + [(x, h - z) for x, z in reversed(rim)]
    profile += [(r - 1.8, h), (r - 2.2, h - 1.8), (0, h - 1.8)]
    pieces = [(lathe(profile), STEEL)]
    pieces.append((lathe([(r + 0.3, 5), (r + 0.3, h - 5)]).without_hulls(), label))
    stripe = rng.uniform(0.3, 0.6)
    pieces.append(
        (
            lathe([(r + 0.5, stripe * h), (r + 0.5, (stripe + 0.2) * h)]).without_hulls(),
            pick(rng, (WHITE, CREAM, *BRIGHT)),
        )
    )
    pieces.append((disc(r * 0.62, 0.5).without_hulls().moved(z=h - 1.95), STEEL))
    return pieces, np.pi * (r / 100) ** 2 * (h / 100) * rng.uniform(0.9, 1.1)


def box(rng: np.random.Generator) -> Draft:
    """A carton on one of its faces, with printed panels."""
    small, middle, large = rng.uniform(32, 62), rng.uniform(60, 105), rng.uniform(95, 170)
    color = pick(rng, (*BRIGHT, CARDBOARD, WHITE, NAVY, CREAM))
    accent = pick(rng, (WHITE, *BRIGHT, CREAM, BLACK))
    size = (large, middle, small)
    pieces = [(block(*size, radius=1.2, bevel=1.0), color)]
    panel = block(size[0] * rng.uniform(0.5, 0.8), size[1] * rng.uniform(0.3, 0.6), 0.3, 2).without_hulls()
    pieces.append((panel.moved(x=rng.uniform(-0.08, 0.08) * size[0], z=small - 0.05), accent))
    side = block(size[0] * 0.7, small * 0.5, 0.3, 1).without_hulls().rotated("x", 90)
    pieces += [(side.moved(y=-middle / 2 + 0.05, z=small / 2), accent)]
    pieces.append((block(0.9, middle, 0.3, 0.3).without_hulls().moved(x=large / 2 - 14, z=small - 0.05), BLACK))
    return pieces, small * middle * large * 1e-6 * rng.uniform(0.25, 0.6)
