"""Slabs of the dissertation's chapter 5 and their clusters, with primitive, length and lateral curvature of each.

A slab holds some fifty of the object's 256 points, so all its distances are cheaper than a k-d tree; the sums of all
neighbourhoods are one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from grasping.geometry.primitives import FLAT, Primitive, primitive_by_share
from grasping.geometry.slabs import Rest, slab_of
from grasping.geometry.surface_variation import smallest_eigenvalue_share

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_I, _J = np.triu_indices(3)


@dataclass(frozen=True)
class Region:
    """A slab (cluster is None) or one of its clusters: indices (M,) of its points, length L in m, and P."""

    slab: int
    cluster: int | None
    members: IntArray
    primitive: Primitive
    length: float
    curvature: float


@dataclass(frozen=True)
class RegionRules:
    """What decides on regions: the parameters of the same names of `PublishedPlanner`."""

    height: float
    rest: Rest
    slab_points: int
    cluster_tolerance: float
    cluster_points: tuple[int, int]
    neighbour_divisors: tuple[int, int]
    least_neighbours: tuple[int, int]


def regions_of(local: FloatArray, rules: RegionRules) -> list[Region]:
    """Regions of the points (N, 3) along the object's axes: each slab and, where it falls apart, its clusters."""
    moments = np.column_stack([np.ones(len(local)), local, local[:, _I] * local[:, _J]])
    slab = slab_of(local[:, 1], rules.height, rules.rest)
    least, most = rules.cluster_points
    cut: list[tuple[int, int | None, IntArray]] = []
    sums: list[FloatArray] = []
    for i in np.unique(slab[slab >= 0]).tolist():
        members = np.flatnonzero(slab == i)
        if len(members) <= rules.slab_points:
            continue
        points = local[members]
        square = cdist(points, points, "sqeuclidean")
        cut.append((i, None, members))
        sums.append(_sums(moments[members], square, rules))
        pieces = _components(square <= rules.cluster_tolerance**2)
        for cluster, piece in enumerate(pieces if len(pieces) > 1 else []):
            if least <= len(piece) <= most:
                cut.append((i, cluster, members[piece]))
                sums.append(_sums(moments[members[piece]], square[piece[:, None], piece], rules))
    if not cut:
        return []
    sigma = smallest_eigenvalue_share(_covariances(np.concatenate(sums)))
    found, start = [], 0
    for i, cluster_or_none, members in cut:
        stop = start + len(members)
        primitive = primitive_by_share(int(np.count_nonzero(sigma[start:stop] <= FLAT)), len(members))
        x = local[members, 0]
        length, curvature = float(x.max() - x.min()), float(sigma[stop] + sigma[stop + 1])
        found.append(Region(i, cluster_or_none, members, primitive, length, curvature))
        start = stop + 2
    return found


def _sums(moments: FloatArray, square: FloatArray, rules: RegionRules) -> FloatArray:
    """Sums of the moments (M, 10) over the neighbourhood of each of a region's points, then of its two sides.

    A neighbourhood is the k nearest points, itself included, and those that are as near as the k-th.
    """
    count = len(moments)
    around, beside = (
        min(max(fewest, count // divisor), count)
        for divisor, fewest in zip(rules.neighbour_divisors, rules.least_neighbours, strict=True)
    )
    x = moments[:, 1]
    sides = [int(x.argmax()), int(x.argmin())]
    ordered = np.sort(square, axis=1)
    near = np.concatenate([square <= ordered[:, around - 1, None], square[sides] <= ordered[sides, beside - 1, None]])
    return near.astype(np.float64) @ moments


def _covariances(sums: FloatArray) -> FloatArray:
    """(M, 10) sums of 1, coordinates and their products → (M, 3, 3); zero, which is flat, of fewer than 3 points."""
    count = sums[:, :1]
    mean = sums[:, 1:4] / count
    product = sums[:, 4:] / count - mean[:, _I] * mean[:, _J]
    product[count[:, 0] < 3] = 0.0
    covariance = np.empty((len(sums), 3, 3))
    covariance[:, _I, _J] = product
    covariance[:, _J, _I] = product
    return covariance


def _components(joined: BoolArray) -> list[IntArray]:
    """Connected components of a graph (N, N), the largest first: its nodes each, in order."""
    left = np.ones(len(joined), dtype=bool)
    found = []
    while left.any():
        reached = joined[int(left.argmax())]
        while (farther := joined[reached].any(axis=0)).sum() > reached.sum():
            reached = farther
        found.append(np.flatnonzero(reached))
        left &= ~reached
    return sorted(found, key=len, reverse=True)
