"""Strangers with crisp edges: turned, bent, folded and put together from the catalogue's builders.

Each is a generator as those of the catalogue are; lengths in mm. They are kinds of things, as wide as they come, not
copies of any.
"""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.convex_hulls import simplify_hull
from pecgrasp_env.objects.meshing.shapes import (
    Shape,
    block,
    disc,
    extrude,
    lathe,
    loft,
    skin,
    smooth_path,
    superellipse,
    tube,
)
from pecgrasp_env.objects.model import Color, Draft
from pecgrasp_env.objects.procedural.colors import BLACK, CHARCOAL, GREY, STEEL, pick
from pecgrasp_env.objects.procedural.strangers.common_draws import between, mass_of, paint
from pecgrasp_env.objects.procedural.vessels import vessel

__all__ = [
    "brush",
    "coil",
    "device",
    "dish",
    "lamp",
    "pierced_box",
    "pump",
    "ring",
    "shell",
    "stack",
    "superquadric",
    "tapered",
    "tool",
    "turned",
    "vehicle",
    "wand",
]


def superquadric(rng: np.random.Generator) -> Draft:
    """From a pillow to a pebble, a ball, an egg, a bar of soap, a lozenge (Barr, 1981)."""
    half = np.array([between(rng, 12, 110), between(rng, 12, 75), between(rng, 7, 60)])
    upright, level = between(rng, 1.2, 6), between(rng, 1.2, 6)
    t = np.linspace(-1, 1, 21)[1:-1]
    z = np.sign(t) * (1 - (1 - np.abs(t)) ** 1.6)
    wide = (1 - np.abs(z) ** upright) ** (1 / upright) * (1 + rng.uniform(-0.45, 0.45) * (rng.random() < 0.4) * z)
    outline = superellipse(half[0], half[1], level, 36)
    sections = [
        np.column_stack([outline * w, np.full(36, half[2] * level_z)]) for w, level_z in zip(wide, z, strict=True)
    ]
    return [(loft(np.array(sections), 1.5), paint(rng))], mass_of(rng, 5 * half.prod())


def turned(rng: np.random.Generator) -> Draft:
    """Whatever a lathe makes: a spool, a bulb, a candlestick, a cone, a knob, a skittle, a lid."""
    height, radius = between(rng, 18, 240), between(rng, 9, 75)
    n = int(rng.integers(2, 7))
    knots = radius * rng.uniform(rng.choice([0.15, 0.5]), 1, n)
    if rng.random() < 0.5:  # flowing
        z = np.linspace(0, 1, 26)
        r = np.interp(z, np.linspace(0, 1, n), knots)
        for _ in range(int(rng.integers(1, 12))):
            r[1:-1] = (r[:-2] + 2 * r[1:-1] + r[2:]) / 4
        profile = np.column_stack([r, z * height])
    else:  # stepped
        cuts = np.sort(rng.uniform(0.05, 0.95, n - 1))
        level = np.concatenate([[0], np.repeat(cuts, 2) + np.tile([-0.004, 0.004], n - 1), [1]])
        profile = np.column_stack([np.repeat(knots, 2), np.maximum.accumulate(level) * height])
    flatten = rng.uniform(0.35, 1) if rng.random() < 0.25 else 1.0
    body = lathe(profile, 36, flatten, 1.5)
    if rng.random() < 0.35:
        body = body.rotated("y", 90)
    return [(body, paint(rng))], mass_of(rng, 2 * radius**2 * height)


def shell(rng: np.random.Generator) -> Draft:
    """A hollow body of revolution, open at its top: a tumbler, a goblet, a vase, a bucket, a saucepan, a mortar."""
    return _hollow(rng, between(rng, 0.4, 4.5))


def dish(rng: np.random.Generator) -> Draft:
    """The same, but shallow: a plate, a saucer, a frying pan, a lid, an ashtray, a tray for drinks."""
    return _hollow(rng, between(rng, 0.08, 0.35))


def _hollow(rng: np.random.Generator, deep: float) -> Draft:
    """`deep` radii; now and then with a handle, two ears, or a stem."""
    radius = between(rng, 18, 110)
    height = float(np.clip(radius * deep, 9, 260))
    wall = rng.uniform(2.5, 5)
    floor = rng.uniform(3, 0.25 * height + 3)
    foot = radius * rng.uniform(0.35, 1.0)
    t = np.linspace(0, 1, 13)
    r = foot + (radius - foot) * t ** between(rng, 0.3, 3) + radius * rng.uniform(-0.25, 0.3) * np.sin(np.pi * t)
    z = 1.5 + (height - 2.5) * t
    outside = np.concatenate([[[r[0] - 1.5, 0]], np.column_stack([np.maximum(r, wall + 5), z])])
    flatten = rng.uniform(0.5, 0.9) if rng.random() < 0.25 else 1.0
    color = paint(rng)
    body = vessel(outside, wall, min(floor, 0.5 * height), sectors=10, levels=3 if height < 2 * radius else 2)
    pieces = [(body.scaled(y=flatten), color)]
    kind = rng.integers(6)
    if kind == 0:  # a straight handle
        length, at = between(rng, 60, 190), rng.uniform(0.5, 0.95)
        start = float(np.interp(at * height, z, r))
        path = smooth_path([(start - 2, 0, at * height), (start + length, 0, at * height + rng.uniform(0, 25))], 8)
        pieces.append((tube(path, rng.uniform(10, 26), rng.uniform(6, 16), fit=2.0, exponent=3), paint(rng)))
    elif kind == 1:  # two ears
        at, reach = 0.8 * height, rng.uniform(12, 30)
        start, wide = float(np.interp(at, z, r)), rng.uniform(12, 28)
        for side in (1, -1):
            knots = [(side * (start - 2), -wide, at), (side * (start + reach), 0, at), (side * (start - 2), wide, at)]
            pieces.append((tube(smooth_path(knots, 10), 8, 8, fit=2.0), color))
    elif kind == 2 and height > 40:  # a stem and a foot below
        stem = between(rng, 20, 90)
        pieces = [(shape.moved(z=stem), c) for shape, c in pieces]
        base = lathe([(0.7 * radius, 0), (0.65 * radius, 4), (6, 9), (5, stem + 2)], 28, fit=1.5)
        pieces.append((base, color))
    return pieces, rng.uniform(0.05, 0.7)


def wand(rng: np.random.Generator) -> Draft:
    """Long and bent: a banana, a hook, a horn, a hose, a cane, a boomerang, a croissant."""
    length, thick = between(rng, 70, 260), between(rng, 7, 46)
    turn = rng.uniform(-3.6, 3.6) if rng.random() < 0.75 else rng.uniform(-0.3, 0.3)
    s = np.linspace(0, 1, 22)
    angle = turn * s ** between(rng, 0.6, 2.5) * (np.cos(rng.choice([0, np.pi]) * s) if rng.random() < 0.3 else 1)
    thick = min(thick, 0.35 * length)
    step = length / 22
    if abs(turn) > 0.5:  # no tighter than it is thick
        step = max(step, 0.75 * thick * abs(turn) / 22 * 1.6)
    path = np.column_stack([np.cumsum(np.cos(angle)), np.cumsum(np.sin(angle)), 0 * s]) * step
    grown = 1 + rng.uniform(-0.4, 0.6) * np.sin(np.pi * s) + rng.uniform(-0.45, 0.45) * (s - 0.5)
    flat = rng.uniform(0.45, 1.2)
    body = tube(
        path, thick * grown, thick * flat * grown, exponent=rng.choice([2.0, 2.0, 4.0]),
        round_ends=thick * rng.choice([0.0, 0.5, 1.0]), fit=2.0, n=20,
    )  # fmt: skip
    return [(body, paint(rng))], mass_of(rng, 0.8 * thick**2 * length * flat)


def ring(rng: np.random.Generator) -> Draft:
    """A torus, a roll of tape, a bracelet, a rim; one in four is drawn out to a frame."""
    large, small = between(rng, 16, 85), between(rng, 3, 30)
    small, tall = min(small, 0.7 * large), between(rng, 4, 55)
    n, m = 36, 14
    section = superellipse(small / 2, tall / 2, rng.choice([2.0, 2.0, 5.0, 9.0]), m)
    course = superellipse(1, rng.uniform(0.4, 1) if rng.random() < 0.25 else 1, rng.choice([2.0, 2.0, 6.0]), n)
    sections = np.empty((n, m, 3))
    sections[..., :2] = course[:, None] * (large + section[None, :, :1])
    sections[..., 2] = section[:, 1]
    surface = skin(sections, loop=True)
    hulls = tuple(simplify_hull(np.concatenate([sections[(i + j) % n] for j in range(4)])) for i in range(0, n, 3))
    body = Shape(surface.vertices, surface.faces, hulls)
    if rng.random() < 0.25:
        body = body.rotated("x", 90)
    return [(body, paint(rng))], mass_of(rng, 5 * large * small * tall)


def _head(rng: np.random.Generator, size: float) -> Shape:
    """What may sit at the end of a handle, about the origin."""
    kind = rng.integers(7)
    a, b, c = size * rng.uniform(0.5, 1.2), size * rng.uniform(0.3, 1), size * between(rng, 0.06, 0.8)
    if kind == 0:  # across: a hammer, a mallet
        return block(b, 1.5 * a, max(c, 0.3 * b), 2.0, 1.0).moved(z=-c / 2)
    if kind == 1:
        return lathe([(0.5 * b, -a), (0.55 * b, -0.6 * a), (0.5 * b, a)], 24, fit=1.5).rotated("x", 90)
    if kind == 2:  # flat: a spatula, a racket, a paddle
        thick = rng.uniform(2.5, 9)
        return extrude(superellipse(a, b, between(rng, 2, 6), 28), thick, 0.8).moved(z=-thick / 2)
    if kind == 3:
        return lathe([(0.5 * c, -0.5 * a), (b, 0), (0.4 * c, 0.5 * a)], 24, fit=1.5).rotated("y", 90)
    if kind == 4:  # a ball, a bulb
        angle = np.linspace(-1.45, 1.45, 13)
        return lathe(np.column_stack([0.6 * b * np.cos(angle), 0.6 * a * np.sin(angle)]), 24, fit=1.5).rotated("y", 90)
    if kind == 5:  # a bent blade
        path = smooth_path([(-0.5 * a, 0, 0), (0.5 * a, 0, 0.1 * a), (a, 0, rng.uniform(-0.8, 0.8) * a)], 10)
        return tube(path, b, rng.uniform(3, 8), exponent=5, fit=2.0)
    return block(1.4 * a, b, max(c, 4), 1.5, 0.8).moved(z=-max(c, 4) / 2)


def tool(rng: np.random.Generator) -> Draft:
    """A handle and a head, lying along x: hammers, spoons, spatulas, torches, brushes, screwdrivers, rackets."""
    length, thick = between(rng, 60, 200), between(rng, 6, 38)
    handle_color, head_color = paint(rng), paint(rng)
    s = np.linspace(0, 1, 12)
    swell = 1 + rng.uniform(-0.3, 0.3) * np.sin(np.pi * s * rng.integers(1, 4)) + rng.uniform(-0.3, 0.3) * (s - 0.5)
    path = np.column_stack([length * s, rng.uniform(-0.12, 0.12) * length * s**2, 0 * s])
    grip = tube(path, thick * swell, thick * swell * rng.uniform(0.4, 1.1), exponent=between(rng, 2, 5),
                round_ends=rng.choice([0.0, thick / 2]), fit=1.5, n=20)  # fmt: skip
    pieces = [(grip, handle_color)]
    reach, neck = 0.0, between(rng, 3, 14)
    if rng.random() < 0.45:
        reach = between(rng, 20, 130)
        shaft = lathe([(neck / 2, -4), (neck / 2 * rng.uniform(0.6, 1), reach + 3)], 16, fit=1.5).rotated("y", -90)
        pieces.append((shaft, STEEL if rng.random() < 0.5 else head_color))
    if reach == 0 or rng.random() < 0.75:
        size = between(rng, 12, 60)
        pieces.append((_head(rng, size).rotated("z", 180).moved(x=-reach - 0.3 * size), head_color))
    return pieces, rng.uniform(0.03, 0.6)


def brush(rng: np.random.Generator) -> Draft:
    """A back with rods in rows: forks, combs, rakes, brushes, racks, plugs with many pins, toy tables, stools."""
    nx, ny = int(rng.integers(2, 7)), int(rng.choice([1, 1, 1, 2, 2, 3]))
    thick, long = between(rng, 2.5, 12), between(rng, 12, 110)
    gap = thick * rng.uniform(1.3, 3.5)
    plate = (nx * gap, max(ny * gap, thick * 1.3), between(rng, 4, 30))
    color, rods = paint(rng), paint(rng)
    rod = disc(thick / 2, long, 0, 12) if rng.random() < 0.6 else block(thick, thick * rng.uniform(0.4, 1), long, 0.5)
    pieces = [(block(*plate, 1.0), color)]
    splay = rng.uniform(-10, 10)
    for i in range(nx):
        for j in range(ny):
            x, y = (i - (nx - 1) / 2) * gap, (j - (ny - 1) / 2) * gap
            pieces.append((rod.rotated("y", splay * (2 * i / max(nx - 1, 1) - 1)).moved(x, y, plate[2] - 2), rods))
    if rng.random() < 0.5:
        handle = lathe([(0.3 * plate[1], 0), (between(rng, 4, 14), -between(rng, 30, 150))][::-1], 18, fit=1.5)
        pieces.append((handle.moved(z=2), color))
    turn = rng.choice([0, 90, 90, 180])
    return [(shape.rotated("x", turn), c) for shape, c in pieces], rng.uniform(0.03, 0.5)


def device(rng: np.random.Generator) -> Draft:
    """A flat case with things on it: remote controls, telephones, calculators, keyboards, radios, power banks."""
    a, b, c = between(rng, 55, 210), between(rng, 28, 120), between(rng, 7, 45)
    color, extra = paint(rng), paint(rng)
    radius = rng.uniform(1.5, min(a, b) * rng.choice([0.1, 0.45]))
    pieces = [(block(a, b, c, radius, min(rng.uniform(0.5, 6), c / 3)), color)]
    nx, ny = int(rng.integers(0, 7)), int(rng.integers(1, 4))
    for i in range(nx):
        for j in range(ny):
            key = min(a / nx, b / ny) * rng.uniform(0.3, 0.7)
            x, y = ((i + 0.5) / nx - 0.5) * 0.85 * a, ((j + 0.5) / ny - 0.5) * 0.8 * b
            knob = disc(key / 2, 3, 0.5, 16) if rng.random() < 0.5 else block(key, key * 0.7, 3, 0.8)
            pieces.append((knob.without_hulls().moved(x, y, c - 1), extra))
    if rng.random() < 0.4:  # an aerial, a cable's start, a plug
        rod = disc(between(rng, 2.5, 9), between(rng, 15, 120), 0.5, 14).rotated("y", 90)
        pieces.append((rod.moved(x=a / 2 - 3, y=rng.uniform(-0.4, 0.4) * b, z=c / 2), extra))
    return pieces, mass_of(rng, a * b * c)


def pierced_box(rng: np.random.Generator) -> Draft:
    """Boards at right angles: frames, crates, shelves, corner pieces, channels, trays, steps, crosses."""
    a, b, c, t = between(rng, 40, 230), between(rng, 35, 160), between(rng, 20, 150), between(rng, 3, 14)
    boards = {
        "floor": block(a, b, t, 0.8),
        "roof": block(a, b, t, 0.8).moved(z=c - t),
        "left": block(t, b, c, 0.8).moved(x=-(a - t) / 2),
        "right": block(t, b, c, 0.8).moved(x=(a - t) / 2),
        "back": block(a, t, c, 0.8).moved(y=(b - t) / 2),
        "front": block(a, t, c, 0.8).moved(y=-(b - t) / 2),
        "middle": block(t, b, c, 0.8),
        "shelf": block(a, b, t, 0.8).moved(z=c / 2),
    }
    wanted = (
        ("floor", "left"), ("floor", "left", "right"), ("floor", "left", "back"), ("left", "right", "floor", "roof"),
        ("floor", "middle"), ("left", "right", "middle", "floor"), ("left", "right", "back", "front"),
        ("floor", "left", "right", "back", "front"), ("floor", "roof", "middle"), ("left", "right", "shelf"),
        ("middle", "shelf"), ("floor", "left", "right", "back", "roof", "shelf"),
    )  # fmt: skip
    color = paint(rng)
    chosen = wanted[int(rng.integers(len(wanted)))]
    return [(boards[name], color) for name in chosen], mass_of(rng, 1.5 * t * (a * b + b * c))


def stack(rng: np.random.Generator) -> Draft:
    """Two to five plain bodies on, beside and through one another, in no order."""
    pieces: list[tuple[Shape, Color]] = []
    top, spread = 0.0, rng.uniform(0, 0.5)
    for _ in range(int(rng.integers(2, 6))):
        a, b, c = between(rng, 15, 120), between(rng, 15, 90), between(rng, 6, 80)
        kind = rng.integers(4)
        if kind == 0:
            shape = block(a, b, c, min(a, b) * rng.uniform(0.03, 0.4), min(1.5, c / 4))
        elif kind == 1:
            shape = disc(b / 2, c, min(1, c / 4))
        elif kind == 2:
            shape = lathe([(a / 2, 0), (a / 2 * rng.uniform(0.1, 0.9), c)], 28, fit=1.5)
        else:
            angle = np.linspace(-1.45, 1.45, 13)
            shape = lathe(np.column_stack([b / 2 * np.cos(angle), c / 2 * (1 + np.sin(angle))]), 28, fit=1.5)
        if rng.random() < 0.3:
            shape = shape.rotated(str(rng.choice(["x", "y"])), rng.choice([90.0, rng.uniform(15, 75)]))
        low = float(shape.vertices[:, 2].min())
        offset = spread * rng.uniform(-60, 60, 2) if pieces else (0.0, 0.0)
        shape = shape.rotated("z", rng.choice([0.0, 90.0, rng.uniform(0, 180)])).moved(offset[0], offset[1], top - low)
        pieces.append((shape, paint(rng)))
        if rng.random() < 0.75:
            top = float(shape.vertices[:, 2].max()) - 2
    return pieces, rng.uniform(0.05, 0.8)


def lamp(rng: np.random.Generator) -> Draft:
    """A foot, an arm and a shade: lamps, taps, stands, mushrooms, goosenecks, parasols."""
    foot, height = between(rng, 20, 65), between(rng, 50, 220)
    bend, thick = rng.uniform(-0.7, 0.7) * height, between(rng, 5, 22)
    color, other = paint(rng), paint(rng)
    arm = smooth_path([(0, 0, 2), (0, 0, 0.5 * height), (0.35 * bend, 0, 0.9 * height), (bend, 0, height)], 16)
    size = between(rng, 12, 60)
    shade = lathe([(size * rng.uniform(0.3, 1.2), 0), (size * rng.uniform(0.2, 1), size * rng.uniform(0.3, 1.4))], 28)
    pieces = [
        (disc(foot, between(rng, 5, 25), 1.5), color),
        (tube(arm, thick, thick, up=(0, 1, 0), fit=2.0, n=16), color),
        (shade.rotated("y", float(np.degrees(0.9 * np.arctan2(bend, height)))).moved(bend, 0, height - 3), other),
    ]
    return pieces, rng.uniform(0.1, 0.8)


def vehicle(rng: np.random.Generator) -> Draft:
    """A body on wheels with a cabin: toy cars, lorries, trains, carts, tape dispensers."""
    a, b, c = between(rng, 50, 210), between(rng, 25, 80), between(rng, 12, 50)
    color = paint(rng)
    radius, wide = c * rng.uniform(0.3, 0.8), between(rng, 5, 18)
    pieces = [(block(a, b, c, rng.uniform(1, 8)).moved(z=radius * 0.7), color)]
    cabin = a * rng.uniform(0.2, 0.6)
    pieces.append(
        (block(cabin, b * 0.9, c * rng.uniform(0.5, 1.6), 3).moved(rng.uniform(-0.4, 0.4) * (a - cabin), 0,
                                                                   radius * 0.7 + c - 1), paint(rng))
    )  # fmt: skip
    wheel, black = disc(radius, wide, 1.0, 24).rotated("x", 90), pick(rng, (BLACK, CHARCOAL, GREY))
    for x in np.linspace(-0.35, 0.35, int(rng.integers(2, 4))) * a:
        for side in (-1, 1):
            pieces.append((wheel.moved(float(x), side * b / 2 + wide / 2, radius), black))
    return pieces, mass_of(rng, a * b * c)


def pump(rng: np.random.Generator) -> Draft:
    """A container with something on its top: spray guns, soap pumps, jerricans, watering cans, teapots, kettles."""
    a, height = between(rng, 25, 75), between(rng, 40, 190)
    b = a * rng.uniform(0.45, 1)
    color, other = paint(rng), paint(rng)
    t = np.linspace(0, 1, 12)
    wide = (1 - rng.uniform(0, 0.5) * t**2) * (1 + rng.uniform(-0.15, 0.25) * np.sin(np.pi * t))
    outline = superellipse(a, b, between(rng, 2, 7), 32)
    body = loft(
        np.array(
            [np.column_stack([outline * w, np.full(32, height * level)]) for w, level in zip(wide, t, strict=True)]
        )
    )
    neck, rise = between(rng, 8, 18), between(rng, 8, 45)
    pieces = [(body, color), (disc(neck, rise + 3, 1).moved(z=height - 3), other)]
    if rng.random() < 0.7:  # a nozzle, a trigger
        reach = between(rng, 20, 80)
        head = block(reach, neck * 1.4, between(rng, 8, 28), 2).moved(rng.uniform(0.1, 0.45) * reach, 0, height + rise)
        pieces.append((head.rotated("z", rng.uniform(-20, 20)), other))
    if rng.random() < 0.5:  # a spout or a handle at its side
        at, reach = rng.uniform(0.3, 0.8) * height, between(rng, 20, 70)
        knots = [
            (0.8 * a, 0, at),
            (a + 0.6 * reach, 0, at + 0.3 * reach),
            (a + reach, 0, at + rng.uniform(0.2, 1) * reach),
        ]
        pieces.append((tube(smooth_path(knots, 10), between(rng, 8, 22), 12, up=(0, 1, 0), fit=2.0, n=16), color))
    return pieces, rng.uniform(0.08, 0.9)


def tapered(rng: np.random.Generator) -> Draft:
    """Two outlines joined: pyramids, wedges, toothpaste tubes, tins with shoulders, chisels, pouches, roofs."""
    a, b, height = between(rng, 15, 90), between(rng, 8, 60), between(rng, 20, 220)
    n = 32
    low = superellipse(a, b, between(rng, 1.2, 8), n)
    high = superellipse(a * between(rng, 0.12, 1.4), b * between(rng, 0.08, 1.4), between(rng, 1.2, 8), n)
    turn, t = rng.uniform(-1, 1) * (rng.random() < 0.3), np.linspace(0, 1, 9)
    lean = rng.uniform(-0.5, 0.5, 2) * height * (rng.random() < 0.3)
    sections = []
    for s in t:
        c, d = np.cos(turn * s), np.sin(turn * s)
        flat = ((1 - s) * low + s * high) @ np.array([[c, d], [-d, c]]) + lean * s
        sections.append(np.column_stack([flat, np.full(n, height * s)]))
    body = loft(np.array(sections), 1.5)
    pieces = [(body, paint(rng))]
    if rng.random() < 0.4:  # a cap
        pieces.append(
            (disc(between(rng, 6, 20), between(rng, 6, 30), 1, 20).moved(lean[0], lean[1], height - 2), paint(rng))
        )
    turn_to = rng.choice([0, 90, 90])
    return [(shape.rotated("y", turn_to), c) for shape, c in pieces], mass_of(rng, 3 * a * b * height)


def coil(rng: np.random.Generator) -> Draft:
    """A wound line: springs, coils of cable, whisks, spirals, rings of keys."""
    radius, thick, turns = between(rng, 10, 60), between(rng, 3.5, 11), rng.uniform(1.2, 4)
    rise = rng.choice([rng.uniform(0.05, 0.3), rng.uniform(1.1, 2)]) * thick
    s = np.linspace(0, 1, int(16 * turns) + 4)
    angle, grow = 2 * np.pi * turns * s, 1 + rng.uniform(-0.6, 0.3) * s
    path = np.column_stack([radius * grow * np.cos(angle), radius * grow * np.sin(angle), rise * turns * s])
    body = tube(path, thick, thick, fit=3.0, n=12)
    if rng.random() < 0.3:
        body = body.rotated("x", 90)
    return [(body, paint(rng))], rng.uniform(0.03, 0.3)
