"""Open crates whose load lies at one end: held by two walls."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import block
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BLUE, BROWN, CARDBOARD, GREY, RED, STEEL, pick


def crate(rng: np.random.Generator) -> Draft:
    """Standing on its floor, long along x."""
    length, width, height = rng.uniform(380, 540), rng.uniform(240, 330), rng.uniform(110, 170)
    wall, floor = rng.uniform(13, 19), rng.uniform(9, 14)
    color = pick(rng, (BROWN, CARDBOARD, BLUE, RED, GREY))
    end, side = block(wall, width, height, 2), block(length - 2 * wall + 1, wall, height, 2)
    pieces = [(block(length - 2, width - 2, floor, 2), color)]
    pieces += [(end.moved(x=s * (length - wall) / 2), color) for s in (-1, 1)]
    pieces += [(side.moved(y=s * (width - wall) / 2), color) for s in (-1, 1)]
    room = length - 2 * wall
    load = rng.uniform(0.25, 0.45) * room
    beside = rng.choice((-1, 1)) * ((room - load) / 2 - rng.uniform(30, 60))  # room for a finger behind the wall
    inner = block(load, (width - 2 * wall) * rng.uniform(0.4, 0.65), (height - floor) * rng.uniform(0.2, 0.6), 2)
    pieces.append((inner.moved(x=beside, z=floor - 0.5), pick(rng, (STEEL, CARDBOARD, GREY))))
    return pieces, rng.uniform(1.5, 6.0)
