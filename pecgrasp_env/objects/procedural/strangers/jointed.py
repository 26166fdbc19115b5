"""Strangers of two like parts that are joined: at a pivot, a hinge, a bridge or a band. Lengths in mm."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.convex_hulls import simplify_hull
from pecgrasp_env.objects.meshing.shapes import (
    Shape,
    block,
    disc,
    extrude,
    lathe,
    skin,
    smooth_path,
    superellipse,
    tube,
)
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.strangers.common_draws import between, mass_of, paint

__all__ = ["folding", "headset", "shears", "spectacles", "strap"]


def hoop(half_x: float, half_y: float, thick: float, high: float, exponent: float = 2.0) -> Shape:
    """A closed band about z, its section rounded."""
    n, m = 32, 12
    section, course = superellipse(thick / 2, high / 2, 2.5, m), superellipse(1, 1, exponent, n)
    sections = np.empty((n, m, 3))
    sections[..., :2] = course[:, None] * (np.array([half_x, half_y]) + section[None, :, :1])
    sections[..., 2] = section[:, 1]
    surface = skin(sections, loop=True)
    hulls = (np.concatenate([sections[(i + j) % n] for j in range(5)]) for i in range(0, n, 4))
    return Shape(surface.vertices, surface.faces, tuple(map(simplify_hull, hulls)))


def shears(rng: np.random.Generator) -> Draft:
    """Two flat levers that cross at a pivot, with eyes for the fingers: scissors, tongs, pruners, compasses."""
    blade, shank = between(rng, 35, 130), between(rng, 30, 90)
    wide, thick = between(rng, 6, 22), between(rng, 2.5, 6)
    eye = np.array([between(rng, 10, 26), between(rng, 9, 18)])
    open_, tip = rng.uniform(3, 40), rng.uniform(0.1, 0.8)
    grip, metal = paint(rng), paint(rng)
    pieces = []
    bend = rng.uniform(5, 22)
    for side in (-1, 1):
        outline = np.array([(-0.2 * blade, -wide / 2), (0.4 * blade, -wide / 2), (blade, -tip * wide / 2),
                            (blade, tip * wide / 2), (0.4 * blade, wide / 2), (-0.2 * blade, wide / 2)])  # fmt: skip
        half = [(extrude(outline, thick).moved(z=side * thick / 2 - thick / 2), metal)]
        path = smooth_path([(0, 0, 0), (-0.5 * shank, side * 0.3 * bend, 0), (-shank, side * bend, 0)], 10)
        half.append((tube(path, 0.8 * wide, 1.5 * thick, exponent=3, fit=1.5, n=16).moved(z=side * thick / 2), grip))
        ring = hoop(eye[0], eye[1], between(rng, 4, 9), 2 * thick)
        half.append((ring.moved(-shank - 0.8 * eye[0], side * (bend + 0.3 * eye[1]), side * thick / 2), grip))
        pieces += [(shape.rotated("z", -side * open_ / 2), color) for shape, color in half]
    pieces.append((disc(0.4 * wide, 2.6 * thick, 0.5, 16).moved(z=-1.3 * thick), metal))
    return pieces, rng.uniform(0.03, 0.25)


def spectacles(rng: np.random.Generator) -> Draft:
    """Two round things side by side and a bridge: spectacles, goggles, binoculars, handcuffs, dumb-bells, castanets."""
    a, b = between(rng, 15, 34), between(rng, 13, 32)
    apart, long = a + between(rng, 3, 14), between(rng, 4, 110)
    color, other = paint(rng), paint(rng)
    pieces = []
    hollow = rng.random() < 0.6
    for side in (-1, 1):
        if hollow:
            part = hoop(a, b, between(rng, 3, 7), min(long, 25), rng.choice([2.0, 3.0]))
        else:
            part = lathe([(a, 0), (a * rng.uniform(0.6, 1), 0.6 * long), (a * rng.uniform(0.4, 1), long)], 28, fit=1.5)
        pieces.append((part.moved(x=side * apart), color))
    bridge = block(2 * apart - 1.6 * a, between(rng, 4, 14), between(rng, 3, 12), 1.0)
    pieces.append((bridge.moved(z=0.0 if hollow else 0.4 * long), other))
    if hollow and rng.random() < 0.7:  # temples, stretched out or folded
        reach, fold = between(rng, 60, 140), rng.choice([0.0, rng.uniform(60, 85)])
        for side in (-1, 1):
            temple = block(3.5, 3.5, reach, 1.0).rotated("y", -side * fold).moved(side * (apart + 0.95 * a), 0, -1)
            pieces.append((temple, color))
        pieces = [(shape.rotated("x", 90), c) for shape, c in pieces]
    return pieces, rng.uniform(0.03, 0.4)


def headset(rng: np.random.Generator) -> Draft:
    """An arc with something at its ends: headphones, buckets' handles, horseshoes, tongs, padlocks, hair bands."""
    radius, rise = between(rng, 15, 85), rng.uniform(0.7, 1.5)
    s = np.linspace(-0.1, np.pi + 0.1, 24) if rng.random() < 0.6 else np.linspace(-0.5, np.pi + 0.5, 26)
    path = np.column_stack([radius * np.cos(s), radius * rise * np.sin(s), 0 * s])
    wide, thick = between(rng, 5, 0.4 * radius + 6), between(rng, 4, 0.2 * radius + 5)
    pieces = [(tube(path, thick, wide, exponent=3, fit=2.0, n=16), paint(rng))]
    color, kind, size = paint(rng), rng.integers(4), between(rng, 0.25, 0.6) * radius
    for end in (0, -1):
        at = path[end]
        if kind == 0:  # cushions
            part = disc(size, 0.7 * size, 2, 28).rotated("y", 90).moved(x=-0.35 * size)
        elif kind == 1:
            part = block(size, 1.2 * size, max(wide, size), 2).moved(z=-max(wide, size) / 2)
        elif kind == 2:
            angle = np.linspace(-1.45, 1.45, 11)
            part = lathe(np.column_stack([0.6 * size * np.cos(angle), 0.6 * size * np.sin(angle)]), 20, fit=1.5)
        else:
            continue
        pieces.append((part.moved(*at.tolist()), color))
    if kind == 3:  # a body across the ends
        body = block(2.3 * radius, between(rng, 0.6, 1.6) * radius, max(wide, 10), 3)
        pieces.append((body.moved(y=-0.5 * radius, z=-max(wide, 10) / 2), color))
    if rng.random() < 0.4:
        pieces = [(shape.rotated("x", 90), c) for shape, c in pieces]
    return pieces, rng.uniform(0.04, 0.5)


def folding(rng: np.random.Generator) -> Draft:
    """Two boards at a hinge, shut or open: pegs, clips, books, laptops, purses, razors, sandwiches, waffle irons."""
    a, b = between(rng, 40, 190), between(rng, 10, 130)
    low, high = between(rng, 3, 22), between(rng, 3, 22)
    angle = rng.uniform(0, 12) if rng.random() < 0.4 else rng.uniform(12, 130)
    hinge, lap = rng.uniform(0, 0.5) * a * (rng.random() < 0.4), rng.uniform(0.5, 1)
    color, other = paint(rng), paint(rng)
    pieces = [(block(a, b, low, 1.5).moved(x=a / 2 - hinge, z=-low), color)]
    lid = block(a * lap, b * rng.uniform(0.6, 1), high, 1.5).moved(x=a * lap / 2 - hinge * lap)
    pieces.append((lid.rotated("y", -angle), other))
    pin = disc((low + high) / 2, b * rng.uniform(0.5, 1.1), 0.5, 16)
    reach = float(np.ptp(pin.vertices[:, 2]))
    pieces.append((pin.rotated("x", 90).moved(y=reach / 2), color))
    if rng.random() < 0.4:
        pieces = [(shape.rotated("x", 90), c) for shape, c in pieces]
    return pieces, mass_of(rng, a * b * (low + high))


def strap(rng: np.random.Generator) -> Draft:
    """A band with a case on it: watches, collars, belts, lanterns, dog tags, head torches, rings with stones."""
    half = np.array([between(rng, 12, 60), between(rng, 10, 50)])
    wide = between(rng, 4, 30)
    band, color = hoop(half[0], half[1], between(rng, 2.5, 6), wide, rng.choice([2.0, 3.0])), paint(rng)
    other = paint(rng)
    size, deep = between(rng, 0.6, 1.6) * wide, between(rng, 5, 25)
    case = disc(size, deep, 1.5) if rng.random() < 0.6 else block(2 * size, 1.6 * size, deep, 2)
    pieces = [(band, color), (case.rotated("y", 90).moved(x=half[0] - 0.3 * deep), other)]
    if rng.random() < 0.5:  # on its case's side
        pieces = [(shape.rotated("y", -90), c) for shape, c in pieces]
    return pieces, rng.uniform(0.03, 0.25)
