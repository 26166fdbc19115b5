"""How the learning rate runs over a training."""

from __future__ import annotations

import math


def warm_cosine(peak: float, progress: float) -> float:
    """The rate at `progress` in [0, 1): a tenth of the run up to `peak` and a cosine down to nothing."""
    if progress < 0.1:
        return peak * (0.05 + 0.95 * progress / 0.1)
    return peak * (0.5 + 0.5 * math.cos(math.pi * (progress - 0.1) / 0.9))
