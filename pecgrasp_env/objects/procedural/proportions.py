"""How large and in which proportions the things of a class are made: the wide families of the catalogue.

A class has kinds, such as the desk stapler and the mini stapler, each with ranges of its extents; an instance is a
shape of the class's own generator in extents drawn from one of them. The ranges are general knowledge of what is
sold, as far as a gripper of 140 mm can hold it on some side. Millimetres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pecgrasp_env.objects.meshing.shapes import Shape, block, disc, smooth_path, tube
from pecgrasp_env.objects.model import Color, Draft
from pecgrasp_env.objects.procedural.colors import BLACK, BLUE, CHARCOAL, ORANGE, RED, STEEL, pick

__all__ = ["KINDS", "Kind", "in_proportion"]

Range = tuple[float, float]
Generator = Callable[[np.random.Generator], Draft]


def screw_clamp(rng: np.random.Generator) -> Draft:
    """A C or F clamp, lying flat: a frame, a screw through its lower arm with a pad, a handle across the screw."""
    reach, opening = rng.uniform(40, 70), rng.uniform(50, 130)
    thick, broad = rng.uniform(8, 13), rng.uniform(9, 18)
    corner = rng.choice([2.0, 14.0])  # cast frames are round, rails are not
    knots = [(reach, opening, 0), (corner, opening + 0.3 * corner, 0), (0, opening - corner, 0), (0, corner, 0)]
    knots += [(corner, -0.3 * corner, 0), (reach, 0, 0)]
    frame = tube(smooth_path(knots, 36), broad, thick, exponent=5)
    driven = rng.uniform(0.15, 0.7) * opening
    screw = disc(rng.uniform(3.5, 6), driven + 45, 0.8, n=16).rotated("x", -90).moved(reach - 4, -45, 0)
    pad = disc(rng.uniform(7, 11), 6, 1.0, n=20).rotated("x", -90).moved(reach - 4, driven, 0)
    color = pick(rng, (RED, BLUE, ORANGE, BLACK, CHARCOAL, STEEL))
    pieces: list[tuple[Shape, Color]] = [(frame, color), (screw, STEEL), (pad, STEEL)]
    if rng.random() < 0.5:  # a bar to turn it by, or a round grip
        bar = disc(2.8, 48, 0.8, n=12).rotated("y", 90).moved(reach - 28, -42, 0)
        pieces.append((bar, STEEL))
    else:
        grip = disc(rng.uniform(9, 14), 55, 3.0, n=20).rotated("x", 90).moved(reach - 4, -35, 0)
        pieces.append((grip, color))
    return pieces, rng.uniform(0.12, 0.5)


def oval_tin(rng: np.random.Generator) -> Draft:
    """A fish tin: flat, with rounded corners, and a ring to pull."""
    a, b, c = rng.uniform(95, 155), rng.uniform(55, 90), rng.uniform(20, 38)
    color = pick(rng, (STEEL, RED, BLUE, ORANGE))
    tin = block(a, b, c, min(rng.uniform(14, 30), 0.45 * b), 1.5)
    ring = disc(9, 1.4, 0.4, n=20).without_hulls().moved(0.3 * a, 0, c)
    return [(tin, color), (ring, STEEL)], a * b * c * 1e-6 * rng.uniform(0.7, 1.0)


@dataclass(frozen=True)
class Kind:
    """Extents along x, y and z in the generator's own frame; `equal`: round things, y as x."""

    share: float
    x: Range
    y: Range
    z: Range
    equal: bool = False
    generator: Generator | None = None  # in place of the class's own


KINDS: dict[str, tuple[Kind, ...]] = {
    "joypad": (Kind(1, (125, 175), (85, 130), (40, 72)),),
    "mouse": (Kind(0.65, (95, 132), (54, 76), (30, 46)), Kind(0.35, (72, 98), (42, 62), (22, 38))),  # office; travel
    "pliers": (
        Kind(0.6, (125, 215), (42, 78), (9, 18)),
        Kind(0.25, (120, 210), (75, 125), (9, 18)),  # wide open
        Kind(0.15, (190, 260), (42, 80), (10, 20)),  # water-pump and long-nose
    ),
    "stapler": (
        Kind(0.5, (115, 175), (28, 46), (42, 75)),
        Kind(0.25, (85, 118), (24, 40), (34, 60)),  # half strip
        Kind(0.25, (48, 85), (19, 34), (26, 48)),  # mini
    ),
    "plug_adapter": (Kind(1, (42, 85), (38, 65), (38, 75)),),
    "can": (
        Kind(0.3, (50, 70), (50, 70), (88, 172), equal=True),  # drinks
        Kind(0.35, (62, 105), (62, 105), (75, 135), equal=True),  # food
        Kind(0.2, (65, 112), (65, 112), (25, 62), equal=True),  # flat
        Kind(0.15, (90, 155), (50, 90), (20, 40), generator=oval_tin),
    ),
    "box": (
        Kind(0.35, (70, 190), (48, 125), (14, 42)),  # cards, puddings, butter
        Kind(0.35, (120, 260), (75, 180), (35, 85)),  # crackers, sugar
        Kind(0.2, (140, 245), (58, 100), (55, 95)),  # drinks
        Kind(0.1, (55, 130), (50, 110), (45, 100)),
    ),
    "bottle": (
        Kind(0.45, (45, 85), (45, 85), (140, 290), equal=True),  # drinks, rinses
        Kind(0.4, (55, 110), (35, 70), (130, 285)),  # shampoo, ketchup, bleach
        Kind(0.15, (40, 75), (30, 75), (85, 150)),  # travel, medicine
    ),
    "mug": (Kind(0.7, (95, 145), (70, 105), (75, 130)), Kind(0.3, (85, 150), (65, 112), (50, 85))),  # and tea cups
    "bowl": (
        Kind(0.5, (110, 200), (110, 200), (45, 95), equal=True),
        Kind(0.25, (120, 215), (120, 215), (28, 50), equal=True),  # shallow
        Kind(0.25, (75, 120), (75, 120), (30, 62), equal=True),  # ramekins, dips
    ),
    "clamp": (
        Kind(0.6, (75, 210), (42, 150), (16, 42)),
        Kind(0.4, (60, 120), (100, 200), (12, 36), generator=screw_clamp),
    ),
    "drill": (Kind(1, (140, 235), (45, 78), (150, 265)),),
    "wire_cutter": (Kind(1, (95, 185), (34, 68), (8, 17)),),
    "open_wire_cutter": (Kind(1, (85, 165), (72, 150), (8, 17)),),
}


def in_proportion(class_name: str, generator: Generator, rng: np.random.Generator) -> Draft:
    """A draw of the class's generator in the extents of one of its kinds."""
    kinds = KINDS[class_name]
    kind = kinds[int(rng.choice(len(kinds), p=[kind.share for kind in kinds]))]
    pieces, mass = (kind.generator or generator)(rng)
    points = np.concatenate([shape.vertices for shape, _ in pieces])
    # One draw for the size and one for each axis: products that are long are mostly broad, too.
    common, single = rng.random(), rng.random(3)
    share = 0.5 * common + 0.5 * single
    if kind.equal:
        share[1] = share[0]
    low, high = np.array([kind.x, kind.y, kind.z]).T
    wanted = np.exp(np.log(low) + share * np.log(high / low))
    x, y, z = wanted / np.ptp(points, axis=0)
    if kind.equal:
        x = y = wanted[0] / np.ptp(points, axis=0)[:2].max()  # a bulge or a spout leaves round what is round
    return [(shape.scaled(x, y, z), color) for shape, color in pieces], mass * float(np.clip(x * y * z, 0.2, 3.0))
