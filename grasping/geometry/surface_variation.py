"""Surface variation of a neighbourhood: σ = λ0 / (λ0 + λ1 + λ2), λ0 the smallest eigenvalue of its covariance.

On a small disc of radius r of a surface of radius R, σ ≈ r²/(32 R²) on a cylinder and r²/(24 R²) on a sphere: σ grows
with the neighbourhood, so values are comparable only between neighbourhoods of one radius.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grasping.geometry import exact_math

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]


def covariances(neighbourhoods: FloatArray) -> FloatArray:
    """(M, k, 3) neighbourhoods → (M, 3, 3) covariances about their own means; sums run from the first to the last."""
    count, k = neighbourhoods.shape[:2]
    points = np.ascontiguousarray(neighbourhoods.transpose(1, 2, 0))
    points = points - points.sum(axis=0) / k
    covariance = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(i, 3):
            covariance[:, i, j] = covariance[:, j, i] = (points[:, i] * points[:, j]).sum(axis=0) / k
    return covariance


def smallest_eigenvalue_share(covariance: FloatArray) -> FloatArray:
    """(M, 3, 3) symmetric, positive semidefinite → σ (M,) in [0, 1/3]; 0 where all points coincide.

    Closed form of the eigenvalues of a symmetric 3 × 3 matrix by the trigonometric solution of its cubic.
    """
    a00, a11, a22 = covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 2, 2]
    a01, a02, a12 = covariance[:, 0, 1], covariance[:, 0, 2], covariance[:, 1, 2]
    trace = a00 + a11 + a22
    mean = trace / 3.0
    b00, b11, b22 = a00 - mean, a11 - mean, a22 - mean
    square = (b00 * b00 + b11 * b11 + b22 * b22 + 2.0 * (a01 * a01 + a02 * a02 + a12 * a12)) / 6.0
    p = np.sqrt(square)
    half_determinant = 0.5 * (
        b00 * (b11 * b22 - a12 * a12) - a01 * (a01 * b22 - a12 * a02) + a02 * (a01 * a12 - b11 * a02)
    )
    # p is 0 for a multiple of the identity, all of whose eigenvalues are the mean.
    cubed = p * square
    ratio = np.divide(half_determinant, cubed, out=np.zeros_like(p), where=cubed > 1e-300)
    angle = exact_math.arccos(np.clip(ratio, -1.0, 1.0)) / 3.0
    smallest = mean + 2.0 * p * exact_math.cos(angle + 2.0 * np.pi / 3.0)
    return np.clip(np.divide(smallest, trace, out=np.zeros_like(trace), where=trace > 1e-300), 0.0, 1.0 / 3.0)


def surface_variation(points: FloatArray, k: int, tree: cKDTree | None = None) -> FloatArray:
    """σ (N,) around each of the points (N, 3), over its k nearest, itself included (k is cut to N)."""
    return variation_at(points, points, k, tree)


def variation_at(points: FloatArray, queries: FloatArray, k: int, tree: cKDTree | None = None) -> FloatArray:
    """σ (M,) of the k points (of N) that are nearest to each of the queries (M, 3)."""
    k = min(k, len(points))
    if k < 3:
        return np.zeros(len(queries))
    if tree is None:
        from scipy.spatial import cKDTree  # slow to import, and the default planner does without

        tree = cKDTree(points)
    _, index = tree.query(queries, k=k)
    return smallest_eigenvalue_share(covariances(points[index]))


def variation_among(points: FloatArray, queries: FloatArray, k: int) -> FloatArray:
    """`variation_at` for few points: of equally near ones those with the lower index count, on every machine.

    The reference of what `compiled_backend.measure_regions` does.
    """
    k = min(k, len(points))
    if k < 3:
        return np.zeros(len(queries))
    dx, dy, dz = points.T[:, None, :] - queries.T[:, :, None]
    index = np.argsort(dx * dx + dy * dy + dz * dz, axis=1, kind="stable")[:, :k]
    return smallest_eigenvalue_share(covariances(points[index]))
