"""Game controllers: a blended body with two grips, bumpers, sticks, d-pad and four buttons."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.convex_hulls import carve
from pecgrasp_env.objects.meshing.implicit import blend, round_cone, rounded_box, surface_net, top_of
from pecgrasp_env.objects.meshing.shapes import Shape, block, disc, extrude, lathe, superellipse
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import (
    BLACK,
    BLUE,
    CHARCOAL,
    GREEN,
    GREY,
    NAVY,
    PINK,
    RED,
    WHITE,
    YELLOW,
    pick,
)


def joypad(rng: np.random.Generator) -> Draft:
    """x left to right, grips towards -y, buttons up. Two layouts: sticks side by side, or staggered."""
    width = rng.uniform(142, 162)
    s = width / 152
    thick = rng.uniform(12, 15) * s
    grip_length = rng.uniform(56, 68) * s
    droop = rng.uniform(8, 16)
    grip_radius = rng.uniform(12, 15) * s
    spread = width / 2 - grip_radius
    shoulder = rng.uniform(20, 23) * s
    members = [rounded_box((0, 4 * s, 0), (0.34 * width, 29 * s, thick), thick * 0.75)]
    for side in (-1, 1):
        start = (side * (width / 2 - shoulder - rng.uniform(3, 5)), 2 * s, -2)
        members.append(round_cone(start, (side * spread, -grip_length, -droop), shoulder, grip_radius))
        members.append(rounded_box((side * 0.29 * width, 27 * s, 2), (20 * s, 8 * s, 8), 5))
        members.append(round_cone((side * 0.31 * width, 26 * s, -7), (side * 0.31 * width, 35 * s, -15), 9, 7))
    flat = rounded_box((0, 0, 0), (width, width, thick * rng.uniform(1.05, 1.2)), 1)
    solid = blend(members, 10)

    def field(points: np.ndarray) -> np.ndarray:
        """The face is pared down, so that the shoulders do not bulge above the buttons."""
        return np.maximum(solid(points), flat(points) * (points[:, 2] > 0) - 100 * (points[:, 2] <= 0))

    vertices, faces = surface_net(field, (-90, -95, -40), (90, 60, 30), 4.0)
    body = Shape(vertices, faces, tuple(carve(vertices, faces, tolerance=2.0, thinnest=9.0)))
    color = pick(rng, (CHARCOAL, WHITE, BLACK, NAVY, RED, GREY))
    dark = CHARCOAL if color == BLACK else BLACK
    pieces = [(body, color)]

    def on_top(shape: Shape, x: float, y: float, sink: float = 0.8) -> Shape:
        return shape.moved(x, y, top_of(field, x, y, 40) - sink)

    left, right = -0.29 * width, 0.29 * width
    if rng.random() < 0.5:  # side by side
        sticks, cross, buttons = [(-0.155 * width, -10 * s), (0.155 * width, -10 * s)], (left, 9 * s), (right, 9 * s)
    else:  # staggered
        sticks, cross, buttons = [(left, 11 * s), (0.15 * width, -10 * s)], (-0.15 * width, -10 * s), (right, 11 * s)
    stick_radius, stick_height = rng.uniform(8.5, 10), rng.uniform(8.5, 11.5)
    for x, y in sticks:
        pieces.append((on_top(disc(stick_radius + 3.0, 6.0, 0.8), x, y, sink=4.6), dark))
        pieces.append((on_top(_stick(stick_radius, stick_height), x, y), dark))
    arm = rng.uniform(20, 24) * s
    for size in ((arm, arm / 3), (arm / 3, arm)):
        pieces.append((on_top(block(*size, 3.2, 1.0), *cross), dark))
    radius, ring = rng.uniform(4.6, 5.6), rng.uniform(9.5, 11) * s
    for i, accent in enumerate((GREEN, RED, BLUE, YELLOW) if rng.random() < 0.6 else (dark, dark, dark, dark)):
        angle = i * np.pi / 2
        button = disc(radius, 3.4, 1.0, n=20)
        pieces.append((on_top(button, buttons[0] + ring * np.cos(angle), buttons[1] + ring * np.sin(angle)), accent))
    if rng.random() < 0.5:  # touch pad
        pieces.append((on_top(block(0.27 * width, 22 * s, 1.6, 3).without_hulls(), 0, 13 * s), dark))
    else:
        pieces.append((on_top(disc(6.5, 1.6, 0.6).without_hulls(), 0, 18 * s), pick(rng, (GREEN, WHITE, BLUE, PINK))))
    pill = extrude(superellipse(4.5, 1.9), 1.8, 0.5).without_hulls()
    for x in (-0.17, 0.17):
        pieces.append((on_top(pill, x * width, 17 * s), dark))
    return pieces, rng.uniform(0.19, 0.29)


def _stick(radius: float, height: float) -> Shape:
    """A thumb stick: a neck under a dished cap."""
    return lathe(
        [(0.55 * radius, -1), (0.5 * radius, height - 4.5), (0.9 * radius, height - 3), (radius, height - 1.6),
         (0.96 * radius, height - 0.5), (0.8 * radius, height), (0.6 * radius, height - 0.7), (0, height - 1.2)],
        n=24,
    )  # fmt: skip
