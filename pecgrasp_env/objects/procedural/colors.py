"""Colours (linear RGB, 0..1) that the generators draw from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pecgrasp_env.objects.model import Color

BLACK: Color = (0.015, 0.015, 0.017)
CHARCOAL: Color = (0.05, 0.05, 0.055)
GREY: Color = (0.22, 0.22, 0.23)
STEEL: Color = (0.42, 0.43, 0.45)
BRASS: Color = (0.55, 0.38, 0.12)
WHITE: Color = (0.82, 0.82, 0.8)
CREAM: Color = (0.75, 0.68, 0.5)
RED: Color = (0.55, 0.03, 0.025)
ORANGE: Color = (0.75, 0.2, 0.02)
YELLOW: Color = (0.78, 0.5, 0.02)
GREEN: Color = (0.04, 0.3, 0.07)
TEAL: Color = (0.01, 0.27, 0.3)
BLUE: Color = (0.02, 0.1, 0.45)
NAVY: Color = (0.015, 0.035, 0.12)
PURPLE: Color = (0.2, 0.05, 0.35)
PINK: Color = (0.7, 0.2, 0.3)
BROWN: Color = (0.2, 0.09, 0.035)
CARDBOARD: Color = (0.45, 0.29, 0.15)

BRIGHT = (RED, ORANGE, YELLOW, GREEN, TEAL, BLUE, PURPLE, PINK)


def pick(rng: np.random.Generator, colors: Sequence[Color]) -> Color:
    """One of the colours."""
    return colors[int(rng.integers(len(colors)))]
