"""Free-form deformation: a smooth map of space that makes another thing of the same kind out of a whole object.

A displacement by a coarse lattice of control points (Sederberg & Parry, 1986), then a taper, a twist and a bend
along one axis, then scales along all three. The map is one to one, so what is closed stays closed and no face turns
inside out.
"""

from __future__ import annotations

from itertools import product

import numpy as np

__all__ = ["FreeForm"]

_ORDER = 3  # of the Bernstein polynomials: 4 × 4 × 4 control points


class FreeForm:
    """A map drawn by `rng` for what lies in the box from `lower` to `upper`, (3,) each, in the points' unit.

    strength: standard deviation of the logarithm of the scales; the taper, bend, twist and lattice go with it. 0.15
    changes proportions about as products of one kind differ. 0 maps each point to itself.
    """

    def __init__(self, lower: np.ndarray, upper: np.ndarray, strength: float, rng: np.random.Generator) -> None:
        self._centre = (np.asarray(lower, float) + upper) / 2
        self._half = np.maximum((np.asarray(upper, float) - lower) / 2, 1e-9)
        # Within two deviations: beyond, two draws of one thing are of different kinds.
        common, single = np.clip(rng.normal(), -2, 2), np.clip(rng.normal(size=3), -2, 2)
        self._scales = np.exp(strength * (0.7 * common + 0.7 * single))
        self._along = int(rng.choice(3, p=_shares(self._half)))
        self._across = (self._along + 1 + int(rng.integers(2))) % 3
        self._taper = strength * rng.uniform(-0.8, 0.8)
        self._bend = strength * rng.uniform(-0.8, 0.8)
        self._twist = strength * rng.uniform(-0.6, 0.6)
        # Up to strength 1 / 2.25 the derivative's row sums stay below 1, so that nothing folds.
        self._lattice = strength * rng.uniform(-0.25, 0.25, (_ORDER + 1, _ORDER + 1, _ORDER + 1, 3))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(N, 3) mapped points."""
        q = (np.asarray(points, float) - self._centre) / self._half  # -1 … 1
        q = q + self._displacement(q)
        t = q[:, self._along]
        others = [axis for axis in range(3) if axis != self._along]
        q[:, others] *= (1 + self._taper * np.clip(t, -1, 1))[:, None]
        p = q * self._half
        c, s = np.cos(self._twist * t), np.sin(self._twist * t)
        a, b = p[:, others[0]].copy(), p[:, others[1]].copy()
        p[:, others[0]], p[:, others[1]] = c * a - s * b, s * a + c * b
        # A shear that grows with the square of the way: a bend that never folds back.
        p[:, self._across] += self._bend * self._half[self._along] / 2 * t**2
        return p * self._scales + self._centre

    def _displacement(self, q: np.ndarray) -> np.ndarray:
        t = np.clip((q + 1) / 2, 0, 1)
        weight = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])  # (4, N, 3)
        moved = np.zeros_like(q)
        for i, j, k in product(range(_ORDER + 1), repeat=3):
            moved += (weight[i, :, 0] * weight[j, :, 1] * weight[k, :, 2])[:, None] * self._lattice[i, j, k]
        return moved


def _shares(half: np.ndarray) -> np.ndarray:
    """Long sides taper, bend and twist, flat ones seldom."""
    return half**2 / (half**2).sum()
