"""Spring clamps: two broad bowed levers that do not cross, a coil spring at the pivot, soft pads, sleeved handles."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import Shape, block, disc, lathe, smooth_path, tube
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BLACK, BLUE, CHARCOAL, GREY, ORANGE, RED, STEEL, YELLOW, Color, pick


def clamp(rng: np.random.Generator) -> Draft:
    """Lying on its side, jaws towards +x, handles spread towards -x."""
    s = rng.uniform(0.85, 1.15)
    broad = rng.uniform(19, 27) * s  # along z
    thick = rng.uniform(6.5, 8.5) * s
    jaw, bulge = rng.uniform(48, 62) * s, rng.uniform(18, 24) * s
    handle, spread = rng.uniform(68, 86) * s, rng.uniform(30, 40) * s
    gap = rng.uniform(0.0, 8.0) * s  # closed on nothing, or held a little open
    frame = pick(rng, (BLACK, CHARCOAL, STEEL, GREY))
    accent = pick(rng, (ORANGE, RED, YELLOW, BLUE))
    knots = [(-handle, spread), (-0.5 * handle, 0.72 * spread), (-12 * s, 12 * s), (0, 9.5 * s), (0.42 * jaw, bulge),
             (0.8 * jaw, 0.72 * bulge + gap / 3), (jaw, 9 * s + gap / 2)]  # fmt: skip
    path = smooth_path([(x, y, 0) for x, y in knots], 46)
    t = np.linspace(0, 1, 46)
    lever = tube(path, thick, broad * (0.78 + 0.22 * np.exp(-(((t - 0.5) / 0.25) ** 2))), exponent=5, round_ends=3)
    sleeve = tube(path[:17], thick + 4, 0.8 * broad + 4, exponent=4, round_ends=4)
    pad = block(15 * s, 7.5 * s, 0.85 * broad, 2.2).moved(0, -3.4 * s, -0.425 * broad)
    pad = pad.rotated("z", rng.uniform(-6, 6)).moved(jaw - 5 * s, 7.5 * s + gap / 2)
    pieces: list[tuple[Shape, Color]] = []
    for mirror in (1, -1):
        pieces += [
            (shape.scaled(y=mirror), color) for shape, color in ((lever, frame), (sleeve, accent), (pad, accent))
        ]
    ear = disc(12.5 * s, 3.0, 0.8)
    pieces += [(ear.moved(z=0.5 * broad - 2.5), frame), (ear.moved(z=-0.5 * broad - 0.5), frame)]
    turns = np.linspace(0, 5, 41)
    ripple = 8 * s + 1.3 * np.abs(np.sin(np.pi * turns))
    coil = np.column_stack([ripple, (turns / 5 - 0.5) * (broad - 4)])
    pieces.append((lathe(coil, n=28, fit=1.5), STEEL))
    pieces.append((disc(3.6 * s, broad + 4, 0.8, n=20).moved(z=-broad / 2 - 2), STEEL))
    return pieces, rng.uniform(0.09, 0.2)
