"""An object's own axes, and the side from which it was seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def principal_axes(points: FloatArray) -> FloatArray:
    """(N, d) points → (d, d) orthonormal columns, the direction of the greatest variance first.

    Each sign is chosen so that the third moment along the axis is not negative: it belongs to the object, not to the
    frame in which the object was seen.
    """
    centred = points - points.mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    axes = vectors[:, ::-1]
    along = axes.T @ centred.T  # (d, N): sums over long rows are fast
    skew = (along * along * along).sum(axis=1)
    return axes * np.where(skew < 0.0, -1.0, 1.0)


def object_axes(points: FloatArray) -> FloatArray:
    """Right-handed (3, 3) columns x, y, z with y the long axis, x the second and z the third."""
    long, second, _ = principal_axes(points).T
    return np.column_stack([second, long, np.cross(second, long)])


def inward_axis(points: FloatArray, axis: FloatArray) -> FloatArray:
    """The unit axis (3,), turned away from whoever saw the points (N, 3).

    A seen surface bulges towards the camera: what is farther out across the axis lies farther behind along it.
    """
    offset = points - points.mean(axis=0)
    depth = offset @ axis
    outward = (offset * offset).sum(axis=1) - depth * depth
    return -axis if float(depth @ outward) < 0.0 else axis
