"""How alike two things are in shape and size, however they are turned: by the distances between points of them.

Osada et al., "Shape distributions", ACM Transactions on Graphics 2002 (their D2), with sizes kept.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.distance import pdist

from pecgrasp_env.objects.model import ObjectModel

__all__ = ["ALIKE", "Likeness", "spread_of"]

ALIKE = 0.012
"""Share of the size by which quantiles differ on average: below it two things pass for one another. Members of a class
of the catalogue lie 0.003 to 0.025 from the nearest other of fourteen, 0.007 in the middle."""

_POINTS = 192
_QUANTILES = np.linspace(0.02, 0.98, 25)


def spread_of(model: ObjectModel) -> np.ndarray:
    """Quantiles of the distances between points of the surface, (25,) m."""
    mesh = model.visual_mesh()
    corners = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    rng = np.random.default_rng(0)
    face = rng.choice(len(area), _POINTS, p=area / area.sum())
    u, v = rng.random((2, _POINTS, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = corners[face].transpose(1, 0, 2)
    return np.quantile(pdist(a + u * (b - a) + v * (c - a)), _QUANTILES)


class Likeness:
    """To any of some models."""

    def __init__(self, models: Sequence[ObjectModel]) -> None:
        self._spreads = np.array([spread_of(model) for model in models])

    def to_nearest(self, model: ObjectModel) -> float:
        """The mean difference of quantiles from the nearest model's, as a share of that one's largest."""
        off = np.abs(self._spreads - spread_of(model)).mean(axis=1)
        return float((off / self._spreads[:, -1]).min())

    def is_like(self, model: ObjectModel) -> bool:
        return self.to_nearest(model) < ALIKE
