"""The surface that a cloud lies on, as its camera saw it: fewer points, each with a normal that looks to the camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.geometry.surface_variation import covariances
from grasping.geometry.voxel_grid import cube_means, cubes
from grasping.pose import kernels

FloatArray = NDArray[np.float64]

FINE = 0.0025  # m: of a dense cloud one mean in each cube of it, so that a neighbourhood has one size
NEIGHBOURS = 40  # in which a plane is fitted
SWEEPS = 8  # of Jacobi's rotations, as in symmetric.h
AT_ONCE = 200  # places of which NumPy compares the distances to all points
UNLIKE = 0.5  # length of the mean of normals below which a cube holds no one surface


def seen_surface(points: FloatArray, eye: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Points (M, 3), about a spacing (m) apart, and their normals (M, 3) of a cloud (N, 3) seen from the eye (3,)."""
    fine = cube_means(points, cubes(points, FINE))
    kept = _middles(fine, spacing)
    normals = normals_at(kept, fine, min(NEIGHBOURS, len(fine)))
    away = np.einsum("ij,ij->i", normals, kept - eye) > 0.0
    return kept, np.where(away[:, None], -normals, normals)


def normals_at(places: FloatArray, points: FloatArray, k: int) -> FloatArray:
    """Normals (M, 3), of either sign, of the planes through the k of the points (N, 3) nearest to each place (M, 3)."""
    # In the order along the longest side the kernel finds the near ones; of equally near ones both take the first.
    axis = int(np.ptp(points, axis=0).argmax())
    points = np.ascontiguousarray(points[np.argsort(points[:, axis], kind="stable")])
    normals = np.empty((len(places), 3))
    if kernels.compiled is not None:
        kernels.compiled.normals(points, np.ascontiguousarray(places), axis, k, normals)
        return normals
    for first in range(0, len(places), AT_ONCE):
        own = slice(first, first + AT_ONCE)
        dx, dy, dz = points.T[:, None, :] - places[own].T[:, :, None]
        near = np.sort(np.argsort(dx * dx + dy * dy + dz * dz, axis=1, kind="stable")[:, :k], axis=1)
        normals[own] = least_axes(covariances(points[near]))
    return normals


def least_axes(symmetric: FloatArray) -> FloatArray:
    """The axes (M, 3) of length one along which symmetric matrices (M, 3, 3) are least, by Jacobi's rotations."""
    a = symmetric.transpose(1, 2, 0).copy()
    axes = np.repeat(np.eye(3)[:, :, None], len(symmetric), axis=2)
    for p, q, r in ((0, 1, 2), (0, 2, 1), (1, 2, 0)) * SWEEPS:
        off = a[p, q]
        with np.errstate(over="ignore"):
            theta = (a[q, q] - a[p, p]) / np.where(off == 0.0, 1.0, 2.0 * off)
            size = 1.0 / (np.abs(theta) + np.sqrt(theta * theta + 1.0))
        t = np.where(theta < 0.0, -size, size)
        c = 1.0 / np.sqrt(t * t + 1.0)
        s = t * c
        c, s, turned = np.where(off == 0.0, 1.0, c), np.where(off == 0.0, 0.0, s), np.where(off == 0.0, 0.0, t * off)
        rp, rq = a[r, p].copy(), a[r, q].copy()
        a[p, p] -= turned
        a[q, q] += turned
        a[p, q] = a[q, p] = 0.0
        a[r, p] = a[p, r] = c * rp - s * rq
        a[r, q] = a[q, r] = s * rp + c * rq
        axes[:, p], axes[:, q] = c * axes[:, p] - s * axes[:, q], s * axes[:, p] + c * axes[:, q]
    least = np.where(a[1, 1] < a[0, 0], 1, 0)
    least = np.where(a[2, 2] < np.take_along_axis(np.stack([a[0, 0], a[1, 1]]), least[None], axis=0)[0], 2, least)
    return np.take_along_axis(axes, least[None, None], axis=1)[:, 0].T


def _middles(points: FloatArray, size: float) -> FloatArray:
    return cube_means(points, cubes(points, size)) if size > FINE else points


def thinner(points: FloatArray, normals: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """One point and normal in each cube of a surface (N, 3), (N, 3), but where two sides share a cube."""
    number = cubes(points, spacing)
    place, normal = cube_means(points, number), cube_means(normals, number)
    length = np.linalg.norm(normal, axis=1)
    kept = length > UNLIKE
    return place[kept], normal[kept] / length[kept, None]
