"""Fewer points that stand for all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.geometry.principal_axes import principal_axes

FloatArray = NDArray[np.float64]


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
