"""Which primitive a region looks like, and whether all regions of an object look alike (dissertation, chapter 5)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from grasping.grasp import Primitive

# Δ, the share of a region's points whose σ is at most FLAT: sphere 0–0.10, cylinder 0.10–0.40, box 0.40–1.
FLAT = 0.01
SPHERE_BELOW = 0.10
CYLINDER_BELOW = 0.40


def primitive_of(sigma: NDArray[np.float64]) -> Primitive:
    """Name the primitive of a region from the σ (M,) of its points. The names depend on neighbourhood and view."""
    return primitive_by_share(int(np.count_nonzero(sigma <= FLAT)), len(sigma))


def primitive_by_share(flat: int, count: int) -> Primitive:
    """Name the primitive of a region of `count` points, `flat` of which have a σ of at most FLAT."""
    delta = flat / count if count else 0.0
    if delta < SPHERE_BELOW:
        return "sphere"
    return "cylinder" if delta < CYLINDER_BELOW else "box"


def all_alike(primitives: Sequence[Primitive], lengths: Sequence[float], tolerance: float) -> bool:
    """Whether consecutive regions agree in primitive and, within the tolerance (m), in length."""
    pairs = zip(primitives, primitives[1:], lengths, lengths[1:], strict=False)
    return all(a == b and abs(m - n) <= tolerance for a, b, m, n in pairs)
