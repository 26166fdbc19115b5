"""Points from all over a surface of triangles."""

from __future__ import annotations

import numpy as np

__all__ = ["doubled_normals", "uniform_points"]


def doubled_normals(corners: np.ndarray) -> np.ndarray:
    """(F, 3) normals of triangles (F, 3, 3), each twice as long as its triangle is large."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def uniform_points(
    corners: np.ndarray, areas: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Points (count, 3), uniform on triangles (F, 3, 3), and which triangle (count,) each is on.

    areas: (F,) of the triangles, in any unit, not all 0.
    """
    face = rng.choice(len(corners), count, p=areas / areas.sum())
    along, across = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    a, b = rng.random((2, count, 1))
    outside = a + b > 1  # the parallelogram's other half, folded back
    a, b = np.where(outside, 1 - a, a), np.where(outside, 1 - b, b)
    return corners[face, 0] + a * along[face] + b * across[face], face
