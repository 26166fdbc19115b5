"""Combination and needle-nose pliers, a little open; the lever builder is shared with the wire cutters."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import Shape, disc, smooth_path, tube
from pecgrasp_env.objects.model import Color, Draft
from pecgrasp_env.objects.procedural.colors import BLACK, BLUE, CHARCOAL, GREEN, ORANGE, RED, STEEL, YELLOW, pick


def pliers(rng: np.random.Generator) -> Draft:
    """Lying flat: jaws towards +x, pivot between, handles splayed towards -x."""
    needle = rng.random() < 0.4
    jaw_length = rng.uniform(52, 68) if needle else rng.uniform(38, 48)
    thick = rng.uniform(10, 13)
    root = rng.uniform(12, 15)
    tip = rng.uniform(3, 4.5) if needle else rng.uniform(6.5, 9)
    tip_thick = 0.4 * thick if needle else 0.75 * thick
    x = np.linspace(2, jaw_length, 12)
    t = (x - 2) / (jaw_length - 2)
    outer = root + (tip - root) * (t**0.8 if needle else t)
    recess = rng.uniform(1.5, 3.0) * np.exp(-(((t - 0.42) / 0.13) ** 2))  # the pipe grip behind the flat tips
    jaw = tube(
        np.column_stack([x, (outer + recess) / 2, 0 * x]), outer - recess, thick + (tip_thick - thick) * t,
        exponent=4.5, round_ends=2.0,
    )  # fmt: skip
    reach = rng.uniform(98, 122)
    bow = rng.uniform(19, 25)
    handle = [(4, 4), (-10, -7), (-0.3 * reach, -bow), (-0.62 * reach, -bow - 2), (-reach, -bow - rng.uniform(-3, 4))]
    grip_color = pick(rng, (RED, BLUE, YELLOW, ORANGE, GREEN, BLACK))
    lever = lever_pieces(jaw, handle, thick, rng.uniform(12.5, 16), rng.uniform(11, 13.5), grip_color, sleeve_from=0.3)
    open_angle = rng.uniform(2, 16)
    pivot_radius = root * rng.uniform(0.95, 1.1)
    return crossed(lever, thick, pivot_radius, open_angle), rng.uniform(0.17, 0.29)


def lever_pieces(
    jaw: Shape,
    handle: list[tuple[float, float]],
    thick: float,
    grip_width: float,
    grip_thick: float,
    grip_color: Color,
    sleeve_from: float,
) -> list[tuple[Shape, Color]]:
    """One lever: its jaw at y > 0, its handle, (x, y) knots, at y < 0, sleeved from a share of its length on."""
    path = smooth_path([(px, py, 0.0) for px, py in handle], 30)
    start = int(sleeve_from * len(path))
    neck = tube(path[: start + 4], np.linspace(1.0, 0.72, start + 4) * grip_width * 0.85, 0.8 * thick, exponent=4)
    s = np.linspace(0, 1, len(path) - start)
    flare = 1 + 0.3 * np.exp(-((s / 0.07) ** 2)) + 0.1 * np.exp(-(((s - 0.55) / 0.25) ** 2)) - 0.12 * s
    sleeve = tube(path[start:], grip_width * flare, grip_thick * (1 + 0.12 * np.exp(-((s / 0.07) ** 2))),
                  exponent=2.4, round_ends=5.0)  # fmt: skip
    return [(jaw, STEEL), (neck, STEEL), (sleeve, grip_color)]


def crossed(
    lever: list[tuple[Shape, Color]], thick: float, pivot_radius: float, open_angle: float
) -> list[tuple[Shape, Color]]:
    """The lever and its mirror image, turned apart by `open_angle` degrees in all about a riveted pivot."""
    pieces = []
    for shape, color in lever:
        pieces.append((shape.rotated("z", open_angle / 2), color))
        pieces.append((shape.scaled(y=-1).rotated("z", -open_angle / 2), color))
    pieces.append((disc(pivot_radius, thick, 1.0).moved(z=-thick / 2), STEEL))
    pieces.append((disc(0.42 * pivot_radius, thick + 2.0, 0.6, n=20).moved(z=-thick / 2 - 1.0), CHARCOAL))
    return pieces
