"""Points of a surface that keep their distance: weighted sample elimination (Yuksel, "Sample Elimination for Generating
Poisson Disk Sample Sets", Eurographics 2015).

Of several times as many random points the one that is most crowded is taken away, again and again.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# α, β, γ of the paper: how steeply crowding grows, and how far points nearer than the least distance still differ.
_STEEPNESS, _LEAST, _LEAST_POWER = 8.0, 0.65, 1.5


def surface_points(
    vertices: FloatArray, faces: NDArray[np.int32], count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, IntArray]:
    """So many random points, uniform over the area of a mesh (V, 3), (F, 3), the normals there, and the faces (count,).

    Faces without area hold none; one face at least must have some.
    """
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_area = np.linalg.norm(across, axis=1)
    ends = np.cumsum(double_area)
    # A stratum a point: even already, so that the elimination begins with fewer clusters.
    where = (np.arange(count) + rng.random(count)) / count * ends[-1]
    face = np.minimum(np.searchsorted(ends, where, side="right"), len(faces) - 1)
    root, v = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - root, root * (1 - v), root * v], axis=1)
    points = np.einsum("ij,ijk->ik", weights, corners[face])
    return points, across[face] / double_area[face, None], face


def eliminate(points: FloatArray, normals: FloatArray, area: float, count: int) -> IntArray:
    """The indices, ascending, of `count` of the points (M, 3), spread over the surface of that area, m².

    Points whose normals (M, 3) part by more than a right angle, on two sides of a wall, do not crowd each other.
    """
    if len(points) <= count:
        return np.arange(len(points))
    farthest = math.sqrt(area / (2 * math.sqrt(3) * count))  # r_max: of disks that fill the plane
    nearest = farthest * (1 - (count / len(points)) ** _LEAST_POWER) * _LEAST
    pairs = cKDTree(points).query_pairs(2 * farthest, output_type="ndarray")
    pairs = pairs[np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]]) > 0]
    distance = np.maximum(np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1), 2 * nearest)
    weight = (1 - distance / (2 * farthest)) ** _STEEPNESS
    one = np.concatenate([pairs[:, 0], pairs[:, 1]])
    order = np.argsort(one, kind="stable")
    other = np.concatenate([pairs[:, 1], pairs[:, 0]])[order].tolist()
    weights = np.concatenate([weight, weight])[order].tolist()
    start = np.searchsorted(one[order], np.arange(len(points) + 1)).tolist()
    crowding = np.bincount(one, np.concatenate([weight, weight]), len(points)).tolist()
    heap = [(-crowd, i) for i, crowd in enumerate(crowding)]
    heapq.heapify(heap)
    alive = [True] * len(points)
    left = len(points)
    while left > count:
        crowd, i = heapq.heappop(heap)
        if not alive[i]:
            continue
        if -crowd > crowding[i] + 1e-12:  # it is less crowded by now: back into the heap, in its place
            heapq.heappush(heap, (-crowding[i], i))
            continue
        alive[i] = False
        left -= 1
        for k in range(start[i], start[i + 1]):
            crowding[other[k]] -= weights[k]
    return np.flatnonzero(alive)
