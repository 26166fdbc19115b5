"""Computer mice: a humped shell with two buttons, a wheel between them, now and then side buttons."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from pecgrasp_env.objects.meshing.shapes import Shape, disc, extrude, loft, skin, superellipse
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BLACK, BLUE, CHARCOAL, GREY, NAVY, RED, TEAL, WHITE, pick

BASE = 4.0  # mm, height of the rim over which the shell arches


def mouse(rng: np.random.Generator) -> Draft:
    """x from the wrist (-) to the buttons (+), flat underneath."""
    length, width, height = rng.uniform(100, 126), rng.uniform(56, 68), rng.uniform(34, 43)
    hump = rng.uniform(0.36, 0.46)  # where the back is highest, as a share of the length
    nose = rng.uniform(0.42, 0.58)  # height of the front edge, as a share of the hump's
    waist = rng.uniform(0.03, 0.1)
    lean = rng.uniform(-0.06, 0.12)  # ergonomic mice lean to one side
    roundness = rng.uniform(2.2, 2.7)
    plan = rng.uniform(2.6, 3.4)
    top = PchipInterpolator([0, 0.12, hump, 0.75, 1], [0.45, 0.72, 1, 0.5 + 0.45 * nose, nose])

    def half_width(u: np.ndarray) -> np.ndarray:
        ends = np.maximum(1 - np.abs(2 * u - 1) ** plan, 0.0) ** (1 / plan)
        return width / 2 * ends * (1 - waist * np.exp(-(((u - 0.55) / 0.16) ** 2)))

    def crown(u: np.ndarray) -> np.ndarray:
        ends = np.maximum(1 - np.abs(2 * u - 1) ** 7, 0.0) ** 0.45
        return (height - BASE) * top(u) * ends

    def surface(x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """Height of the shell above (x, y)."""
        u = np.asarray(x) / length + 0.5
        reach = np.clip(1 - np.abs(np.asarray(y) / np.maximum(half_width(u), 1e-6)) ** roundness, 0, 1)
        return BASE + crown(u) * reach ** (1 / roundness) * (1 + lean * np.asarray(y) / width)

    u = (1 - np.cos(np.linspace(0.06, np.pi - 0.06, 30))) / 2
    arch = superellipse(1, 1, roundness, 48)
    sections = np.empty((len(u), 48, 3))
    for i, (w, h) in enumerate(zip(half_width(u), crown(u), strict=True)):
        upper = arch[:, 1] > 0
        y = arch[:, 0] * w
        low = BASE * (1 - np.abs(superellipse(1, 1, 4, 48)[:, 1]))
        y_low = superellipse(1, 1, 4, 48)[:, 0] * w
        sections[i, :, 0] = (u[i] - 0.5) * length
        sections[i, :, 1] = np.where(upper, y, y_low)
        sections[i, :, 2] = np.where(upper, BASE + arch[:, 1] * h * (1 + lean * y / width), low)
    color = pick(rng, (BLACK, CHARCOAL, WHITE, GREY, NAVY, RED, TEAL))
    seam = GREY if color in (BLACK, CHARCOAL, NAVY) else BLACK
    pieces = [(loft(sections, fit=1.0), color)]

    # Seams: thin ribbons that lie on the shell.
    split = rng.uniform(0.52, 0.6)
    x = (np.linspace(split, 0.975, 24) - 0.5) * length
    pieces.append((_ribbon(np.column_stack([x, 0 * x, surface(x, 0 * x)]), 0.7), seam))
    y = np.linspace(-0.47, 0.47, 30) * width * 0.93
    x = np.full_like(y, (split - 0.5) * length) - 6 * (y / width * 2) ** 2
    pieces.append((_ribbon(np.column_stack([x, y, surface(x, y)]), 0.7), seam))

    wheel_x = (rng.uniform(0.74, 0.8) - 0.5) * length
    radius, breadth = rng.uniform(10, 12.5), rng.uniform(6, 8)
    z = float(surface(wheel_x, 0.0))
    slope = float(np.degrees(np.arctan2(surface(wheel_x - 8, 0.0) - surface(wheel_x + 8, 0.0), 16)))
    slot = extrude(superellipse(radius * 0.9, breadth / 2 + 1.6), 1.4).without_hulls().rotated("y", slope)
    pieces.append((slot.moved(wheel_x, 0, z - 0.8), seam))
    wheel = disc(radius, breadth, 1.5).rotated("x", 90).moved(wheel_x, breadth / 2, z - radius + rng.uniform(3, 4.5))
    pieces.append((wheel, pick(rng, (GREY, BLUE, RED, CHARCOAL))))
    if rng.random() < 0.5:  # a small button behind the wheel
        x0 = wheel_x - 19
        pieces.append((disc(2.6, 1.6, 0.5).without_hulls().moved(x0, 0, float(surface(x0, 0.0)) - 0.6), seam))
    if rng.random() < 0.5:
        for x0 in (-4.0, 12.0):
            edge = float(half_width(np.array((x0 / length) + 0.5)))
            button = extrude(superellipse(6.8, 2.6, 3), 3.2, 0.8).without_hulls().rotated("x", -90)
            pieces.append((button.moved(x0, edge * 0.96 - 2.0, BASE + 0.52 * height * 0.6), seam))
    return pieces, rng.uniform(0.075, 0.125)


def _ribbon(line: np.ndarray, width: float) -> Shape:
    """A flat strip along a line (S, 3) on the shell, barely above it."""
    along = np.gradient(line, axis=0)
    side = np.cross(along, (0, 0, 1.0))
    side *= width / np.linalg.norm(side, axis=1, keepdims=True)
    lift = np.array([0, 0, 0.25])
    return skin(np.stack([line - side - lift, line - side + lift, line + side + lift, line + side - lift], axis=1))
