"""Side cutters: slim and flat, short pointed jaws, two bowed handles; closed, or opened wide."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import tube
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BLUE, GREEN, ORANGE, PURPLE, RED, TEAL, YELLOW, pick
from pecgrasp_env.objects.procedural.pliers import crossed, lever_pieces


def wire_cutter(rng: np.random.Generator) -> Draft:
    """Closed, lying flat, jaws towards +x."""
    return _cutter(rng, open_angle=rng.uniform(0, 3))


def open_wire_cutter(rng: np.random.Generator) -> Draft:
    """Opened wide, as its spring leaves it."""
    return _cutter(rng, open_angle=rng.uniform(34, 52))


def _cutter(rng: np.random.Generator, open_angle: float) -> Draft:
    jaw_length, root = rng.uniform(17, 22), rng.uniform(11, 13.5)
    thick = rng.uniform(8.5, 10)
    x = np.linspace(0, jaw_length, 8)
    t = x / jaw_length
    outer = root * (1 - t) ** 0.75 + 1.6
    jaw = tube(np.column_stack([x, outer / 2, 0 * x]), outer, thick * (1 - 0.45 * t), exponent=4.5, round_ends=1.2)
    reach = rng.uniform(84, 106)
    bow = rng.uniform(11, 15)
    end = rng.uniform(9, 14)
    handle = [(4, 4), (-8, -6), (-0.25 * reach, -bow), (-0.6 * reach, -bow - rng.uniform(2, 5)), (-reach, -end)]
    color = pick(rng, (RED, BLUE, YELLOW, ORANGE, GREEN, TEAL, PURPLE))
    lever = lever_pieces(jaw, handle, thick, rng.uniform(9, 11.5), rng.uniform(10, 11.5), color, sleeve_from=0.24)
    return crossed(lever, thick, root * rng.uniform(0.75, 0.9), open_angle), rng.uniform(0.07, 0.13)
