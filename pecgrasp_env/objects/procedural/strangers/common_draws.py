"""What strangers of every form draw: a colour, sizes, a mass."""

from __future__ import annotations

import numpy as np

from pecgrasp_env.objects.model import Color
from pecgrasp_env.objects.procedural.colors import (
    BLACK,
    BRASS,
    BRIGHT,
    BROWN,
    CARDBOARD,
    CHARCOAL,
    CREAM,
    GREY,
    NAVY,
    STEEL,
    WHITE,
    pick,
)

__all__ = ["between", "mass_of", "paint"]

_COLORS = (*BRIGHT, BLACK, BRASS, BROWN, CARDBOARD, CHARCOAL, CREAM, GREY, NAVY, STEEL, WHITE)


def paint(rng: np.random.Generator) -> Color:
    """Any colour of the catalogue."""
    return pick(rng, _COLORS)


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Evenly over ratios, as sizes of things are."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def mass_of(rng: np.random.Generator, volume_mm3: float) -> float:
    """kg: foam to hardwood, within what lies in a household."""
    return float(np.clip(volume_mm3 * 1e-9 * rng.uniform(120, 800), 0.02, 1.5))
