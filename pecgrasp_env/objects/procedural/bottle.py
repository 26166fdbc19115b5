"""Bottles: round drink bottles and oval squeeze or detergent bottles, with neck and cap."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PchipInterpolator

from pecgrasp_env.objects.meshing.shapes import disc, lathe, loft, rings, sleeve
from pecgrasp_env.objects.model import Draft
from pecgrasp_env.objects.procedural.colors import BLACK, BRIGHT, CREAM, NAVY, WHITE, pick


def bottle(rng: np.random.Generator) -> Draft:
    """Standing; an oval one is broad along x."""
    oval = rng.random() < 0.5
    height = rng.uniform(165, 225)
    radius = rng.uniform(38, 48) if oval else rng.uniform(30, 39)
    depth = rng.uniform(0.58, 0.75) if oval else 1.0  # thickness of the body over its breadth
    neck = rng.uniform(11, 15)
    shoulder = rng.uniform(0.58, 0.7)
    neck_from = rng.uniform(0.82, 0.87)
    waist = rng.uniform(0.0, 0.1)
    stations = np.array(
        [0, 0.012, 0.035, 0.3, 0.5 * shoulder + 0.1, shoulder, 0.5 * (shoulder + neck_from), neck_from, 0.9]
    )
    sizes = np.array([0.9, 0.97, 1, 1, 1 - waist, 0.985, rng.uniform(0.62, 0.8), neck / radius, neck / radius])
    profile = PchipInterpolator(stations, sizes)
    t = np.unique(np.concatenate([stations[:3], np.linspace(0.035, 0.9, 34)]))
    sections = rings(np.column_stack([radius * profile(t), t * height]), 40)
    # Oval below, round at the neck.
    sections[:, :, 1] *= np.interp(t, [shoulder - 0.1, neck_from], [depth, 1.0])[:, None]
    color = pick(rng, (WHITE, CREAM, NAVY, *BRIGHT))
    accent = pick(rng, [c for c in (WHITE, BLACK, *BRIGHT) if c != color])
    pieces = [(loft(sections, fit=1.0), color)]

    cap_low = 0.875 * height
    cap_radius = neck + rng.uniform(2, 4)
    style = rng.integers(3)
    if style == 0:  # screw cap
        pieces.append((disc(cap_radius, height - cap_low, 1.2).moved(z=cap_low), accent))
        pieces.append((disc(cap_radius + 0.8, 3, 0.4).moved(z=cap_low - 4), accent))
    elif style == 1:  # spout
        tall = height - cap_low
        spout = [(cap_radius, 0), (cap_radius, 0.35 * tall), (cap_radius * 0.55, 0.5 * tall), (5.5, 0.65 * tall),
                 (4.2, tall + 8), (3.0, tall + 10), (0, tall + 10)]  # fmt: skip
        pieces.append((lathe(spout).moved(z=cap_low), accent))
    else:  # domed flip top
        tall = height - cap_low
        dome = [
            (cap_radius, 0),
            (cap_radius, 0.6 * tall),
            (0.92 * cap_radius, 0.85 * tall),
            (0.65 * cap_radius, tall),
            (0, tall),
        ]
        pieces.append((lathe(dome).moved(z=cap_low), accent))
    label = (t > 0.12) & (t < shoulder - rng.uniform(0.06, 0.14))
    pieces.append((sleeve(sections[label]), pick(rng, [c for c in (WHITE, CREAM, *BRIGHT) if c != color])))
    return pieces, rng.uniform(0.25, 0.6)
