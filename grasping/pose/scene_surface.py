"""The surface that a cloud lies on, as its camera saw it: fewer points, each with a normal that looks to the camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.geometry.surface_variation import covariances
from grasping.geometry.voxel_grid import cube_means, cubes

FloatArray = NDArray[np.float64]

FINE = 0.0025  # m: of a dense cloud one mean in each cube of it, so that a neighbourhood has one size
NEIGHBOURS = 40  # in which a plane is fitted
UNLIKE = 0.5  # length of the mean of normals below which a cube holds no one surface


def seen_surface(points: FloatArray, eye: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Points (M, 3), about a spacing (m) apart, and their normals (M, 3) of a cloud (N, 3) seen from the eye (3,)."""
    fine = cube_means(points, cubes(points, FINE))
    kept = _middles(fine, spacing)
    _, near = cKDTree(fine).query(kept, k=min(NEIGHBOURS, len(fine)))
    normals = np.linalg.eigh(covariances(fine[near]))[1][:, :, 0]
    away = np.einsum("ij,ij->i", normals, kept - eye) > 0.0
    return kept, np.where(away[:, None], -normals, normals)


def _middles(points: FloatArray, size: float) -> FloatArray:
    return cube_means(points, cubes(points, size)) if size > FINE else points


def thinner(points: FloatArray, normals: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """One point and normal in each cube of a surface (N, 3), (N, 3), but where two sides share a cube."""
    number = cubes(points, spacing)
    place, normal = cube_means(points, number), cube_means(normals, number)
    length = np.linalg.norm(normal, axis=1)
    kept = length > UNLIKE
    return place[kept], normal[kept] / length[kept, None]
