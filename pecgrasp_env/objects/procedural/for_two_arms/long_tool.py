"""Sledge hammers and mallets: a long handle, and a head at one end."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import block, disc, tube
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BLACK, BROWN, CARDBOARD, CHARCOAL, RED, STEEL, YELLOW, pick


def long_tool(rng: np.random.Generator) -> Draft:
    """Lying on its side, the handle along x, the head across it at one end."""
    handle, thick = rng.uniform(560, 760), rng.uniform(29, 38)
    head, size = rng.uniform(100, 170), rng.uniform(45, 70)
    end = rng.choice((-1, 1))  # the head's; the handle ends there, so that nothing weighs twice
    path = np.column_stack([end * np.linspace(-0.5, 0.5 - size / handle, 12) * handle, np.zeros(12), np.zeros(12)])
    shaft = tube(path, thick, thick * rng.uniform(0.8, 1.0), exponent=rng.uniform(2.2, 4.0))
    if rng.random() < 0.5:
        across = block(size, head, size, 5)
    else:
        across = disc(size / 2, head, 4).rotated("x", 90).moved(y=head / 2, z=size / 2)
    at = (handle - size) / 2 * end
    pieces = [(shaft, pick(rng, (BROWN, CARDBOARD, YELLOW, BLACK)))]
    pieces.append((across.moved(x=at, z=-size / 2), pick(rng, (STEEL, CHARCOAL, RED))))
    return pieces, rng.uniform(1.5, 6.0)
