"""Cordless drills: motor housing with gear case and chuck, a raked handle with trigger, a battery to stand on."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import Shape, block, disc, lathe, loft, skin, superellipse, tube
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import (
    BLACK,
    BLUE,
    CHARCOAL,
    GREEN,
    GREY,
    ORANGE,
    RED,
    STEEL,
    TEAL,
    YELLOW,
    Color,
    pick,
)


def drill(rng: np.random.Generator) -> Draft:
    """Standing on its battery, chuck towards +x."""
    body_radius = rng.uniform(25, 30)
    body_length = rng.uniform(108, 128)
    handle_height = rng.uniform(88, 104)
    rake = np.tan(np.radians(rng.uniform(6, 13)))
    battery = (rng.uniform(72, 90), rng.uniform(54, 64), rng.uniform(24, 40))
    color = pick(rng, (YELLOW, TEAL, RED, BLUE, GREEN, ORANGE))
    axis_z = battery[2] + handle_height + 0.8 * body_radius
    rear = -body_length * rng.uniform(0.48, 0.56)
    pieces: list[tuple[Shape, Color]] = []

    def along_x(profile: list[tuple[float, float]], fit: float = 1.0) -> Shape:
        """A lathed piece about the spindle: (radius, x)."""
        return lathe(profile, n=40, fit=fit).rotated("y", 90).moved(z=axis_z)

    r, front = body_radius, rear + body_length
    housing = [
        (0.55 * r, rear), (0.8 * r, rear + 1.5), (0.95 * r, rear + 7), (r, rear + 18),
        (r, rear + 0.6 * body_length), (0.94 * r, front - 12), (0.88 * r, front),
    ]  # fmt: skip
    pieces.append((along_x(housing), color))
    chuck = front + rng.uniform(16, 22)
    collar = [(0.8 * r, front - 1), (0.84 * r, front + 1), (0.84 * r, chuck - 1), (0.76 * r, chuck)]
    pieces.append((along_x(collar), CHARCOAL))
    tip = chuck + rng.uniform(30, 40)

    def between(share: float) -> float:
        return chuck + share * (tip - chuck)

    jaws = [
        (16, chuck - 1), (18.5, chuck + 2), (18.5, between(0.55)), (15, between(0.6)),
        (13, between(0.8)), (8, tip), (0, tip),
    ]  # fmt: skip
    pieces.append((along_x(jaws), BLACK))
    if rng.random() < 0.5:
        bit = rng.uniform(25, 45)
        pieces.append((along_x([(2.6, tip - 3), (2.6, tip + bit - 3), (0.5, tip + bit)]), STEEL))
    slot = block(2.6, 2 * r + 0.6, 0.36 * r, 1.2).without_hulls()
    pieces += [(slot.moved(rear + x, 0, axis_z - 0.18 * r), BLACK) for x in (16, 23, 30)]  # cooling slots

    # The handle leans: its foot is further back than its top. Both ends flare into what they join.
    z = np.linspace(battery[2] - 3, axis_z - 0.35 * r, 22)
    t = (z - z[0]) / (z[-1] - z[0])

    def near(end: float, width: float) -> np.ndarray:
        return np.exp(-(((t - end) / width) ** 2))

    along = rng.uniform(37, 43) * (1 + 0.2 * near(0, 0.12) + 0.38 * near(1, 0.2) + 0.05 * np.sin(np.pi * t))
    across = rng.uniform(29, 33) * (1 + 0.18 * near(0, 0.1) + 0.1 * near(1, 0.25))
    centre = rear + 0.47 * body_length - rake * (z[-1] - z)
    unit = superellipse(0.5, 0.5, 2.6, 36)
    sections = np.empty((len(z), len(unit), 3))
    sections[..., 0] = centre[:, None] + along[:, None] * unit[:, 0]
    sections[..., 1] = across[:, None] * unit[:, 1]
    sections[..., 2] = z[:, None]
    pieces.append((loft(sections, fit=1.0), color))
    gripped = (t > 0.1) & (t < 0.78)
    rubber = sections[gripped]
    rubber[..., 0] = centre[gripped, None] + (rubber[..., 0] - centre[gripped, None]) * 1.02 - 0.5
    rubber[..., 1] *= 1.03
    pieces.append((skin(rubber), CHARCOAL))

    trigger_z = z[0] + 0.72 * (z[-1] - z[0])
    trigger_x = float(np.interp(trigger_z, z, centre + along / 2))
    lever = np.array([[3.0, 0, 13], [1.5, 0, 0], [3.5, 0, -13]]) + np.array([trigger_x, 0, trigger_z])
    pieces.append((tube(lever, 13, 14, exponent=3, up=(0, 1, 0), round_ends=4), pick(rng, (BLACK, RED, GREY))))

    foot_x = float(centre[0]) + rng.uniform(2, 10)
    pieces.append((block(*battery, radius=9, bevel=3.5).moved(x=foot_x), BLACK))
    pieces.append((block(battery[0] * 0.92, battery[1] * 0.9, 9, 8, 2.5).moved(foot_x, 0, battery[2] - 2), color))
    release = disc(7, battery[1] + 1.6, 0.6, n=24).rotated("x", 90).without_hulls()
    pieces.append((release.moved(foot_x + 0.22 * battery[0], battery[1] / 2 + 0.8, 0.55 * battery[2]), GREY))
    return pieces, rng.uniform(0.8, 1.25)
