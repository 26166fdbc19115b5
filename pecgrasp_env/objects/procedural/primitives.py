"""Plain shapes of wide sizes, to learn from what touches what, not what it is: no part of the catalogue.

Each is a generator as those of the catalogue are; lengths in mm.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from functools import lru_cache

import numpy as np

from pecgrasp_env.objects.meshing.shapes import Shape, block, disc, extrude, lathe, smooth_path, superellipse, tube
from pecgrasp_env.objects.model import Draft, ObjectModel, assemble
from pecgrasp_env.objects.procedural.colors import BRIGHT, CREAM, NAVY, STEEL, WHITE, pick
from pecgrasp_env.objects.procedural.vessels import vessel

__all__ = ["CONTAINERS", "PRIMITIVES", "make_primitive"]

_LIGHT, _HEAVY = 0.03, 1.5  # kg


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _color(rng: np.random.Generator) -> tuple[float, float, float]:
    return pick(rng, (*BRIGHT, CREAM, NAVY, WHITE, STEEL))


def _mass(rng: np.random.Generator, volume_mm3: float) -> float:
    return float(np.clip(volume_mm3 * 1e-9 * rng.uniform(150, 700), _LIGHT, _HEAVY))


def cuboid(rng: np.random.Generator) -> Draft:
    """From a matchbox to a shoe box; a third are flat, as books are."""
    a, b = _log_uniform(rng, 25, 240), _log_uniform(rng, 25, 180)
    c = rng.uniform(10, 35) if rng.random() < 0.33 else _log_uniform(rng, 20, 160)
    rounding = min(rng.choice([0.8, 2.0, 6.0]), c / 4)
    return [(block(a, b, c, rounding), _color(rng))], _mass(rng, a * b * c)


def cylinder(rng: np.random.Generator) -> Draft:
    """From a roll of coins to a tube for posters; one in four is cut off a cone."""
    radius, height = _log_uniform(rng, 9, 60), _log_uniform(rng, 25, 230)
    top = radius * (rng.uniform(0.6, 0.95) if rng.random() < 0.25 else 1.0)
    profile = [(radius - 1, 0), (radius, 1), (top, height - 1), (top - 1, height)]
    return [(lathe(profile, 36), _color(rng))], _mass(rng, np.pi * radius**2 * height)


def ball(rng: np.random.Generator) -> Draft:
    """Or an egg."""
    radius, stretch = rng.uniform(15, 55), rng.choice([1.0, rng.uniform(1.1, 1.7)])
    angle = np.linspace(-np.pi / 2, np.pi / 2, 15)
    profile = np.column_stack([radius * np.cos(angle), radius * stretch * np.sin(angle)])[1:-1]
    return [(lathe(profile, 30), _color(rng))], _mass(rng, 4.2 * radius**3 * stretch)


def prism(rng: np.random.Generator) -> Draft:
    """Three to six sides."""
    sides = int(rng.integers(3, 7))
    angle = np.sort(rng.uniform(0, 0.5, sides) + np.arange(sides)) / sides * 2 * np.pi
    outline = np.column_stack([np.cos(angle), np.sin(angle)]) * _log_uniform(rng, 25, 80)
    height = _log_uniform(rng, 20, 180)
    return [(extrude(outline, height), _color(rng))], _mass(rng, 2.5 * outline[0] @ outline[0] * height)


def flask(rng: np.random.Generator) -> Draft:
    """A bottle with a neck."""
    radius, height = rng.uniform(22, 48), rng.uniform(90, 260)
    neck, shoulder = radius * rng.uniform(0.25, 0.6), height * rng.uniform(0.5, 0.8)
    t = np.linspace(0, 1, 6)
    curve = np.column_stack([neck + (radius - neck) * np.cos(t * np.pi / 2), shoulder + t * (height - shoulder) * 0.6])
    profile = [(radius - 2, 0), (radius, 2), *curve.tolist(), (neck, height - 1), (neck - 1, height)]
    return [(lathe(profile, 32, fit=1.5), _color(rng))], _mass(rng, 2.2 * radius**2 * height)


def stick(rng: np.random.Generator) -> Draft:
    """A pen, a brush, a candle: lying along x."""
    radius, length = _log_uniform(rng, 3.5, 11), rng.uniform(100, 210)
    tip = rng.uniform(0.2, 1) * radius
    body = lathe([(radius, 0), (radius, 0.85 * length), (tip, length)], 20).rotated("y", 90)
    return [(body, _color(rng))], _mass(rng, 3 * radius**2 * length)


def cutlery(rng: np.random.Generator) -> Draft:
    """A spoon, a fork, a knife or a spatula, flat: lying along x."""
    length, width, thick = rng.uniform(140, 220), rng.uniform(8, 16), rng.uniform(2.5, 5)
    head = superellipse(rng.uniform(0.12, 0.25) * length, rng.uniform(8, 26), rng.choice([2.0, 4.0]), 24)
    head = head + np.array([0.3 * length, 0])
    handle = block(0.75 * length, width, thick, 1.0, 0.5).moved(x=-0.12 * length)
    return [(handle, _color(rng)), (extrude(head, thick), STEEL)], rng.uniform(0.03, 0.12)


def basin(rng: np.random.Generator) -> Draft:
    """A bowl or a deep plate."""
    radius = rng.uniform(45, 115)
    height = radius * rng.uniform(0.2, 0.9)
    wall, floor = rng.uniform(3, 5), rng.uniform(5, 9)
    foot = radius * rng.uniform(0.4, 0.7)
    t = np.linspace(0, 1, 9)
    z = 2 + (height - 3) * t
    outer = foot + (radius - foot) * np.sin(t * np.pi / 2) ** rng.uniform(0.8, 1.4)
    outside = np.concatenate([[[foot - 2, 0]], np.column_stack([outer, z])])
    return [(vessel(outside, wall, floor, sectors=12, levels=3), _color(rng))], rng.uniform(0.15, 0.6)


def pot(rng: np.random.Generator) -> Draft:
    """A pot with two handles, or none: a tin without lid, a tumbler."""
    radius = _log_uniform(rng, 32, 105)
    height = np.clip(radius * rng.uniform(0.7, 2.2), 50, 160)
    pieces = [(_cup(rng, radius, height), color := _color(rng))]
    if radius > 60 and rng.random() < 0.7:
        z, reach = 0.8 * height, rng.uniform(15, 30)
        for side in (1, -1):
            path = smooth_path([(side * radius, -25, z), (side * (radius + reach), 0, z), (side * radius, 25, z)], 12)
            pieces.append((tube(path, 10, 8, fit=2.0), color))
    return pieces, rng.uniform(0.15, 0.9)


def cup(rng: np.random.Generator) -> Draft:
    """A mug: one handle."""
    radius, height = rng.uniform(32, 52), rng.uniform(60, 120)
    pieces = [(_cup(rng, radius, height), color := _color(rng))]
    reach = rng.uniform(22, 36)
    knots = [(radius - 2, 0, 0.85 * height), (radius + reach, 0, 0.55 * height), (radius - 2, 0, 0.2 * height)]
    pieces.append((tube(smooth_path(knots, 14), rng.uniform(8, 14), 8, up=(0, 1, 0), fit=2.0), color))
    return pieces, rng.uniform(0.15, 0.45)


def _cup(rng: np.random.Generator, radius: float, height: float) -> Shape:
    foot = radius * rng.uniform(0.75, 1.0)
    z = np.linspace(2, height - 1, 6)
    outside = np.concatenate([[[foot - 2, 0]], np.column_stack([np.linspace(foot, radius, 6), z])])
    return vessel(outside, rng.uniform(3, 4.5), rng.uniform(5, 8), sectors=12, levels=2)


def tray(rng: np.random.Generator) -> Draft:
    """A carton without its lid, from a shallow tray to a deep box."""
    a, b, height, wall = rng.uniform(90, 260), rng.uniform(80, 200), _log_uniform(rng, 20, 110), rng.uniform(3, 5)
    sides = [block(a, b, wall, 0.5)]
    for side in (1, -1):
        sides.append(block(wall, b, height, 0.5).moved(x=side * (a - wall) / 2))
        sides.append(block(a - 2 * wall, wall, height, 0.5).moved(y=side * (b - wall) / 2))
    color = _color(rng)
    return [(shape, color) for shape in sides], rng.uniform(0.1, 0.5)


def plate(rng: np.random.Generator) -> Draft:
    """A saucer, a lid, a disc."""
    radius, height = rng.uniform(35, 110), rng.uniform(6, 16)
    return [(disc(radius, height, 2.0), _color(rng))], _mass(rng, 3.1 * radius**2 * height)


PRIMITIVES: dict[str, Callable[[np.random.Generator], Draft]] = {
    generator.__name__: generator
    for generator in (cuboid, cylinder, ball, prism, flask, stick, cutlery, basin, pot, cup, tray, plate)
}
CONTAINERS = ("basin", "pot", "tray")
"""Open at their tops, as they stand in their own frames."""


@lru_cache(maxsize=2048)
def make_primitive(name: str, seed: int) -> ObjectModel:
    """The instance of a shape of `PRIMITIVES` that `seed` (>= 0) draws: the same in every process."""
    pieces, mass = PRIMITIVES[name](np.random.default_rng([zlib.crc32(name.encode()), seed]))
    return assemble(name, f"{name}_{seed:04d}", pieces, mass)
