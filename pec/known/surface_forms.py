"""How the surface of a cloud is formed, in 78 numbers that no rotation changes: flat, round, edged, hollow.

A network that is shown few ordered points sees sizes and proportions well and small forms badly: whether a cylinder
ends in a lid or is a mug, whether a flat thing is a box or a mouse. Here each point has the plane of its neighbours;
pairs of points are counted by how far apart they are, how their planes are inclined to each other, and how far one lies
off the other's plane (after the point pair features of Wahl et al., "Surflet-pair-relation histograms", 3DIM 2003, but
without signs: which side is outside is not known).

extent (3), skewness (3, without sign), kurtosis (3)     along the principal axes, the longest first
pairs (5 x 4, 5 x 4)    shares of the pairs of one of five distances, by inclination, and by distance off the plane
bend, line (7, 7)       quantiles over the points: how uneven, and how drawn out, their neighbourhoods are
facing (3 x 5)          quantiles over the points: how much their planes face along each principal axis
"""

from __future__ import annotations

import numpy as np

from pec.preprocessing import compiled as kernels

__all__ = ["N_FORMS", "reference", "surface_forms"]

N_FORMS = 78

_NEIGHBOURS = 10  # of a point, itself among them
_DISTANCES = np.array([0.4, 0.8, 1.2, 1.7])  # of a pair, in mean distances: borders
_INCLINED = np.array([0.25, 0.7, 0.95])  # |cosine| of the normals: borders
_OFF = np.array([0.1, 0.3, 0.6])  # |sine| of the angle between the line of a pair and a plane: borders
_LEAST = 1e-3  # m, added to lengths whose logarithm is taken
_FLAT = 1e-12  # m², of a variance


def surface_forms(points: np.ndarray) -> np.ndarray:
    """(78,) float64 of points (N, 3), metres, N > 1, evenly spread as farthest point sampling leaves them."""
    if kernels.AVAILABLE and points.dtype == np.float32:
        return kernels.surface_forms(points)
    return reference(points)


def reference(points: np.ndarray) -> np.ndarray:
    """`surface_forms` without the compiled kernel."""
    points = points.astype(np.float64)
    points = points - points.mean(axis=0)
    n = len(points)
    axes = np.linalg.eigh(points.T @ points / n)[1][:, ::-1]
    along = points @ axes
    variance = (along**2).mean(axis=0) + _FLAT
    moments = [
        np.log(np.ptp(along, axis=0) + _LEAST),
        np.abs((along**3).mean(axis=0)) / variance**1.5,
        (along**4).mean(axis=0) / variance**2,
    ]

    squared = ((points[:, None] - points) ** 2).sum(axis=2)
    near = np.argsort(squared, axis=1, kind="stable")[:, :_NEIGHBOURS]
    patches = points[near] - points[near].mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(patches.transpose(0, 2, 1) @ patches / near.shape[1])
    values = np.maximum(values, 0.0)
    normals = vectors[:, :, 0]
    bend = np.sqrt(values[:, 0] / (values.sum(axis=1) + _FLAT))
    line = np.sqrt(values[:, 1] / (values[:, 2] + _FLAT))
    facing = np.abs(normals @ axes)

    first, second = np.triu_indices(n, 1)
    distance = np.sqrt(squared[first, second])
    how_far = np.searchsorted(_DISTANCES, distance / max(distance.mean(), 1e-9), side="right")
    inclined = np.abs((normals[first] * normals[second]).sum(axis=1))
    between = (points[second] - points[first]) / np.maximum(distance, 1e-9)[:, None]
    pairs = np.zeros((2, len(_DISTANCES) + 1, 4))
    np.add.at(pairs[0], (how_far, np.searchsorted(_INCLINED, inclined, side="right")), 2.0)
    for end in (first, second):
        off = np.abs((normals[end] * between).sum(axis=1))
        np.add.at(pairs[1], (how_far, np.searchsorted(_OFF, off, side="right")), 1.0)
    pairs /= np.maximum(pairs.sum(axis=2, keepdims=True), 1.0)
    quantiles = [_quantiles(bend, 7), _quantiles(line, 7), *(_quantiles(facing[:, axis], 5) for axis in range(3))]
    return np.concatenate([*moments, pairs.ravel(), *quantiles])


def _quantiles(values: np.ndarray, n: int) -> np.ndarray:
    return np.sort(values)[np.round(np.linspace(0, 1, n) * (len(values) - 1)).astype(np.int64)]
