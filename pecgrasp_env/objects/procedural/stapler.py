"""Desk staplers: a base, a steel magazine and an arched arm that open about a hinge at the rear."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import block, disc, extrude, smooth_path, superellipse, tube
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
    WHITE,
    pick,
)


def stapler(rng: np.random.Generator) -> Draft:
    """Standing on its base, hinge towards -x, mouth towards +x."""
    length, width = rng.uniform(118, 152), rng.uniform(31, 38)
    base_height = rng.uniform(7, 10)
    hinge_x, hinge_z = -length / 2 + rng.uniform(13, 17), base_height + rng.uniform(12, 15)
    mouth = rng.uniform(4.5, 8.0)  # degrees by which the magazine opens
    lid = mouth + rng.uniform(2.0, 5.0)  # and the arm above it
    color = pick(rng, (BLACK, RED, BLUE, GREY, TEAL, GREEN, ORANGE, WHITE))
    base_color = pick(rng, (BLACK, CHARCOAL, color))
    half = length / 2

    base = extrude(superellipse(half, width / 2, rng.uniform(4, 6), 40), base_height, 2.2)
    anvil = block(20, width * 0.62, 1.6, 3).moved(half - 18, 0, base_height - 0.4)
    pieces = [(base, base_color), (anvil, STEEL)]

    arm_width = rng.uniform(22, 27)
    low, high = base_height - 2, hinge_z + 6
    cheek = extrude(superellipse(13, (high - low) / 2, 3.5), 3.0, 0.8).rotated("x", 90)
    for y in (arm_width / 2 + 3.5, -arm_width / 2 - 0.5):
        pieces.append((cheek.moved(hinge_x, y, (low + high) / 2), base_color))
    pin = disc(3.2, arm_width + 9, 0.6, n=20).rotated("x", 90).moved(hinge_x, (arm_width + 9) / 2, hinge_z)
    pieces.append((pin, STEEL))

    magazine_length = length - 22
    magazine = block(magazine_length, arm_width * 0.62, rng.uniform(8, 10), 1.5, 0.8)
    magazine = magazine.moved(magazine_length / 2 - 6, 0, -6).rotated("y", -mouth)
    pieces.append((magazine.moved(hinge_x, 0, hinge_z), STEEL))

    arm_length = length - 6 - rng.uniform(0, 4)
    rise = rng.uniform(2, 6)
    knots = [
        (-12, 0, 7),
        (0.3 * arm_length, 0, 9 + rise),
        (0.62 * arm_length, 0, 9 + 0.6 * rise),
        (arm_length - 12, 0, 6),
    ]
    path = smooth_path(knots, 24)
    s = np.linspace(0, 1, 24)
    tall = rng.uniform(15, 19) * (1 + 0.16 * np.sin(np.pi * s) - 0.12 * s)
    broad = arm_width * (1 + rng.uniform(0.0, 0.12) * np.sin(np.pi * s))
    arm = tube(path, broad, tall, exponent=rng.uniform(2.8, 4.0), up=(0, 0, 1), round_ends=rng.uniform(7, 11))
    pieces.append((arm.rotated("y", -lid).moved(hinge_x, 0, hinge_z), color))
    nose = block(4, arm_width * 0.66, 15, 1.0, 0.6).moved(magazine_length - 6, 0, -6).rotated("y", -mouth)
    pieces.append((nose.moved(hinge_x, 0, hinge_z), STEEL))
    if rng.random() < 0.5:  # a rubber pad for the thumb
        pad = tube(
            path[14:22] + np.array([0, 0, 0.5 * tall[16] - 1.5]), 0.6 * arm_width, 4.0, exponent=4, round_ends=4
        ).without_hulls()
        pieces.append((pad.rotated("y", -lid).moved(hinge_x, 0, hinge_z), CHARCOAL))
    return pieces, rng.uniform(0.16, 0.32)
