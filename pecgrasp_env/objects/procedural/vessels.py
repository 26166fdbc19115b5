"""Mugs and bowls: hollow, with a wall of convex pieces that leaves the inside free."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.meshing.shapes import Shape, loft, rings, skin, sleeve, smooth_path, tube, wall_hulls
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BLACK, BRIGHT, CREAM, NAVY, WHITE, pick


def mug(rng: np.random.Generator) -> Draft:
    """Standing, its handle towards +x."""
    radius, height = rng.uniform(37, 45), rng.uniform(84, 108)
    wall, floor = rng.uniform(3.4, 4.6), rng.uniform(4.5, 6.5)
    taper = rng.choice([0.0, rng.uniform(0.05, 0.16)])
    belly = rng.choice([0.0, rng.uniform(2.0, 4.0)])
    z = np.linspace(2, height - 1.2, 9)
    t = z / height
    outer_radius = radius * (1 - taper * (1 - t)) + belly * np.sin(np.pi * t)
    outer = np.column_stack([outer_radius, z])
    outside = np.concatenate([[[outer_radius[0] - 2.5, 0.0]], outer])
    color = pick(rng, (WHITE, CREAM, NAVY, BLACK, *BRIGHT))
    pieces = [(vessel(outside, wall, floor, sectors=14, levels=2 if belly == 0 else 4), color)]

    upper, lower = height * rng.uniform(0.8, 0.88), height * rng.uniform(0.16, 0.26)
    reach = rng.uniform(26, 36)
    r_upper, r_lower = (np.interp(level, z, outer_radius) - wall / 2 for level in (upper, lower))
    knots = [
        (r_upper, 0, upper), (r_upper + 0.75 * reach, 0, upper - 2), (radius + reach, 0, 0.6 * upper + 0.4 * lower),
        (r_lower + 0.66 * reach, 0, lower + 9), (r_lower, 0, lower),
    ]  # fmt: skip
    thickness, breadth = rng.uniform(7.5, 10), rng.uniform(10, 15)
    s = np.linspace(-1, 1, 30)
    handle = tube(smooth_path(knots, 30), thickness * (1 + 0.2 * s**4), breadth * (1 + 0.25 * s**4), exponent=2.5,
                  up=(0, 1, 0), fit=1.2)  # fmt: skip
    pieces.append((handle, color))
    if rng.random() < 0.5:  # a painted band
        low, high = np.sort(rng.uniform(0.15, 0.8, 2)) * height + [0, 8]
        level = np.linspace(low, min(high, height - 6), 6)
        band = np.column_stack([np.interp(level, z, outer_radius), level])
        pieces.append((sleeve(rings(band, 56)), pick(rng, [c for c in (*BRIGHT, NAVY, WHITE) if c != color])))
    return pieces, rng.uniform(0.26, 0.42)


def bowl(rng: np.random.Generator) -> Draft:
    """Standing on a foot ring."""
    radius, height = rng.uniform(62, 82), rng.uniform(46, 70)
    foot = radius * rng.uniform(0.4, 0.5)
    wall, floor = rng.uniform(3.2, 4.2), rng.uniform(8, 10)
    fullness = rng.uniform(0.45, 0.65)
    t = np.linspace(0, 1, 14)
    z = 4 + (height - 5 - 4) * t
    outer_radius = foot + 1.5 + (radius - foot - 1.5) * np.sin(t * np.pi / 2) ** (2 * fullness) * (0.92 + 0.08 * t)
    outside = np.concatenate([[[foot - 1, 0.0], [foot, 0.8]], np.column_stack([outer_radius, z])])
    outside = np.concatenate([outside, [[radius + rng.uniform(0, 2), height - 1]]])
    color = pick(rng, (WHITE, CREAM, NAVY, *BRIGHT))
    pieces = [(vessel(outside, wall, floor, sectors=18, levels=5), color)]
    band_z = np.linspace(0.62, 0.76, 5) * height
    band = np.column_stack([np.interp(band_z, z, outer_radius), band_z])
    if rng.random() < 0.5:
        pieces.append((sleeve(rings(band, 72)), pick(rng, [c for c in (*BRIGHT, NAVY, WHITE) if c != color])))
    return pieces, rng.uniform(0.22, 0.45)


def vessel(outside: np.ndarray, wall: float, floor: float, sectors: int, levels: int) -> Shape:
    """A hollow body of revolution.

    outside: (radius, z) from the foot to just under the rim; the inside follows it `wall` mm further in, down to the
    height `floor`. Hulls: the floor as a solid, above it `levels` - 1 courses of `sectors` pieces.
    """
    r, z = outside.T
    steepness = np.arctan2(np.gradient(r), np.gradient(z))
    inner = np.column_stack([r - wall * np.cos(steepness), z + wall * np.sin(steepness)])
    rim = np.array(
        [[r[-1] - 0.15 * wall, z[-1] + 0.75], [r[-1] - 0.5 * wall, z[-1] + 1.0], [r[-1] - 0.85 * wall, z[-1] + 0.75]]
    )
    inner = inner[inner[:, 1] > floor + 1.5]
    inner[-1] = [r[-1] - wall, z[-1]]
    bottom = np.array([[inner[0, 0] - 1.0, floor + 0.6], [inner[0, 0] - 4, floor], [0, floor]])
    n = 4 * sectors
    surface = skin(rings(np.concatenate([outside, rim, inner[::-1], bottom]), n))

    def radius_at(profile: np.ndarray, level: np.ndarray) -> np.ndarray:
        return np.interp(level, profile[:, 1], profile[:, 0])

    below = np.concatenate([outside[z < floor], [[radius_at(outside, np.array(floor)), floor]]])
    base = loft(rings(below, n))
    # Courses closer together near the floor, where a bowl curves most.
    top = z[-1] + 1.0
    level = floor + (top - floor) * np.linspace(0, 1, levels) ** 1.3
    course_out = rings(np.column_stack([radius_at(outside, level), level]), n)
    course_in = rings(
        np.column_stack([np.minimum(radius_at(inner, level), radius_at(outside, level) - 0.8 * wall), level]), n
    )
    return Shape(surface.vertices, surface.faces, base.hulls + wall_hulls(course_out, course_in, sectors))
