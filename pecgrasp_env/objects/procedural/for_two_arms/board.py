"""Planks, half of them with a block fixed on one side of the middle."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import block
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BROWN, CARDBOARD, CREAM, GREY, STEEL, pick


def board(rng: np.random.Generator) -> Draft:
    """Lying flat, along x."""
    length, width, thick = rng.uniform(560, 820), rng.uniform(60, 115), rng.uniform(24, 45)
    pieces = [(block(length, width, thick, 3), pick(rng, (BROWN, CARDBOARD, CREAM)))]
    if rng.random() < 0.5:
        on_top = block(rng.uniform(90, 180), width - 4, rng.uniform(15, 35), 3)
        at = rng.choice((-1, 1)) * rng.uniform(0.12, 0.36) * length
        pieces.append((on_top.moved(x=at, z=thick - 0.5), pick(rng, (GREY, STEEL, BROWN))))
    return pieces, rng.uniform(1.0, 6.0)
