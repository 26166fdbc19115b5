"""How large and in which proportions the things of a class are made: the wide families of the catalogue.

A class has kinds, such as the desk stapler and the mini stapler, each with ranges of its extents; an instance is a
shape of the class's own generator in extents drawn from one of them. The ranges are general knowledge of what is
sold, as far as a gripper of 140 mm can hold it on some side. Millimetres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.further_kinds import oval_tin, ramekin, screw_clamp

__all__ = ["KINDS", "Kind", "in_proportion"]

Range = tuple[float, float]
Generator = Callable[[np.random.Generator], Draft]


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
    "can": (  # they are made in few sizes: 66 by 115, 122 or 168 mm, 53 by 134; 66 or 73 by 85 to 115, 99 by 119 …
        Kind(0.35, (52, 68), (52, 68), (88, 172), equal=True),  # drinks
        Kind(0.25, (64, 88), (64, 88), (78, 118), equal=True),  # soup, vegetables
        Kind(0.1, (92, 108), (92, 108), (95, 135), equal=True),  # coffee, fruit
        Kind(0.18, (64, 110), (64, 110), (28, 60), equal=True),  # flat
        Kind(0.12, (90, 155), (50, 90), (20, 40), generator=oval_tin),
    ),
    "box": (
        Kind(0.25, (70, 125), (42, 90), (18, 38)),  # puddings, butter, tea, soap, medicine
        Kind(0.15, (110, 190), (65, 125), (14, 42)),  # cards, sweets
        Kind(0.3, (120, 260), (75, 180), (35, 85)),  # crackers, sugar
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
        Kind(0.45, (110, 200), (110, 200), (45, 95), equal=True),
        Kind(0.25, (120, 215), (120, 215), (28, 50), equal=True),  # shallow
        Kind(0.1, (75, 120), (75, 120), (30, 62), equal=True),  # dips
        Kind(0.2, (75, 120), (75, 120), (32, 62), equal=True, generator=ramekin),
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
