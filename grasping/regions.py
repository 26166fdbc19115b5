"""An object's own axes, and the slabs and clusters into which it is cut along the long one."""

from __future__ import annotations

from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Rest = Literal["both ends", "lower end", "last slab"]


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


def thinned(points: FloatArray, count: int) -> FloatArray:
    """Every (N / count)-th point in the order of the long axis: the same points whatever their order was."""
    if len(points) <= count:
        return points
    along = (points - points.mean(axis=0)) @ principal_axes(points)[:, 0]
    order = np.argsort(along, kind="stable")
    return points[order[np.linspace(0, len(points) - 1, count).round().astype(np.int64)]]


def spread(points: FloatArray, count: int) -> FloatArray:
    """So many points as far from one another as can be: farthest-point sampling of four times as many (`thinned`).

    It begins with the point that is farthest from the mean.
    """
    points = thinned(points, 4 * count)
    if len(points) <= count:
        return points
    columns = np.ascontiguousarray((points - points.mean(axis=0)).T)
    chosen = np.empty(count, dtype=np.int64)
    nearest = np.full(len(points), np.inf)  # squared distance to the chosen
    distance = np.square(columns).sum(axis=0)
    for i in range(count):
        chosen[i] = last = int(distance.argmax())
        offset = columns - columns[:, last, None]
        offset *= offset
        distance = np.minimum(nearest, offset.sum(axis=0), out=nearest)
    return points[chosen]


def way_in(points: FloatArray, axis: FloatArray) -> FloatArray:
    """The unit axis (3,), turned away from whoever saw the points (N, 3).

    A seen surface bulges towards the camera: what is farther out across the axis lies farther behind along it.
    """
    offset = points - points.mean(axis=0)
    depth = offset @ axis
    outward = (offset * offset).sum(axis=1) - depth * depth
    return -axis if float(depth @ outward) < 0.0 else axis


def slab_of(y: FloatArray, height: float, rest: Rest) -> IntArray:
    """Cut along y (N,) downward into int(H / height) slabs of this height: the slab (N,) of each point, -1 for none.

    rest: where what is left of H lies: at "both ends", half at each, or at the "lower end", in no slab; or as the
    "last slab", which is less high.
    """
    extent = y.max() - y.min()
    whole = int(extent / height)
    above = 0.5 * (extent - whole * height) if rest == "both ends" else 0.0
    order = np.floor((y.max() - above - y) / height).astype(np.int64)
    return np.where(order < whole + (rest == "last slab"), np.maximum(order, -1), -1)


def euclidean_clusters(points: FloatArray, tolerance: float) -> IntArray:
    """Label (N,) of each point: two points share one where a chain of steps of at most the tolerance (m) joins them.

    Labels are 0, 1, … from the largest cluster to the smallest.
    """
    # SciPy is slow to import, and the default planner, which needs this module's axes, does without.
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(points)
    pairs = cKDTree(points).query_pairs(tolerance, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels)
    rank = np.empty(len(sizes), dtype=np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    return rank[labels]


def voxel_clusters(points: FloatArray, tolerance: float) -> IntArray:
    """Euclidean clusters (N,) of a dense cloud, joined through one point in each cube of a fifth of the tolerance."""
    if not len(points):
        return np.empty(0, dtype=np.int64)
    cubes = np.floor((points - points.min(axis=0)) / (tolerance / 5)).astype(np.int64)
    size = cubes.max(axis=0) + 1
    key = (cubes[:, 0] * size[1] + cubes[:, 1]) * size[2] + cubes[:, 2]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return euclidean_clusters(points[first], tolerance)[inverse.reshape(-1)]


def by_label(labels: IntArray) -> list[IntArray]:
    """Indices of each label from 0 up."""
    if not len(labels) or labels.max() < 0:
        return []
    order = np.argsort(labels, kind="stable")
    bounds = np.searchsorted(labels[order], np.arange(labels.max() + 2))
    return [order[start:stop] for start, stop in pairwise(bounds)]
