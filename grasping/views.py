"""The cloud as the gripper sees it along one approach: heights against it, and what is known below the surface."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.regions import object_axes, principal_axes

FloatArray = NDArray[np.float64]

REACHED = 0.08  # m beyond the object in which neighbours matter
CELL = 0.004  # m, in which a footprint is weighed
OBSTACLE_CELL = 0.003  # m, to which neighbours are thinned
BOX = 0.0025  # m, to which large clouds are thinned


@dataclass(frozen=True)
class View:
    """A frame with its third axis against the approach; `origin` in the middle of the object, seen so.

    axes: (3, 3) right-handed columns in the cloud's frame, the first two along the footprint's short and long axis.
    xy, height: the object's points in the frame. obstacle_xy, obstacle_height: of what else is in the way.
    floor: height of the table, or of the lowest point seen. centre: (2,) estimate of the centre of mass.
    """

    origin: FloatArray
    axes: FloatArray
    xy: FloatArray
    height: FloatArray
    obstacle_xy: FloatArray
    obstacle_height: FloatArray
    floor: float
    centre: FloatArray
    tilt: float

    def in_cloud(self, x: float, y: float, height: float) -> FloatArray:
        """A point of this frame in the cloud's."""
        return self.origin + self.axes @ np.array([x, y, height])


def views_from_above(
    cloud: FloatArray,
    up: FloatArray,
    table: FloatArray | None,
    obstacles: FloatArray,
    n_points: int,
    max_tilt: float,
) -> Iterator[View]:
    """Straight down first; then, drawn only when asked for, tilted by `max_tilt` about the footprint's axes."""
    seed = np.eye(3)[int(np.abs(up).argmin())]
    first = np.cross(up, seed)
    first /= np.linalg.norm(first)
    level = np.column_stack([first, np.cross(up, first)])
    low = float((cloud @ up).min())
    table_height = low if table is None else -float(table[3])
    # Points under the table are noise of the table.
    height = np.maximum(cloud @ up - table_height, 0.0)
    flat = cloud @ level
    short = level @ _even_axes(flat, height)[:, 1]
    axes = np.column_stack([short, np.cross(up, short), up])
    thinned = _thin(cloud, axes, n_points)
    straight = _view(thinned, obstacles, axes, table_height, 0.0)
    yield straight
    if max_tilt <= 0.0:
        return
    solid = _columns(thinned, np.maximum(thinned @ up - table_height, 0.0), up)
    table_points = _table_points(straight, table_height, up)
    for angle in (0.5 * max_tilt, max_tilt):
        for about, sign in ((1, 1.0), (1, -1.0), (0, 1.0), (0, -1.0)):
            turned = axes @ _rotation(about, sign * angle)
            yield _view(solid, np.vstack([obstacles, table_points]), turned, None, angle)


def views_without_table(cloud: FloatArray, obstacles: FloatArray, n_points: int) -> Iterator[View]:
    """Approaches along the cloud's own third and second axis, each first from the side to which the cloud bulges."""
    axes = object_axes(cloud)
    for third in (2, 0):
        against = axes[:, third]
        depth = (cloud - cloud.mean(axis=0)) @ against
        # Few points lie far behind a bulging surface: the tail of the distribution shows the way in.
        against = against if float((depth**3).sum()) < 0.0 else -against
        for way in (against, -against):
            short = axes[:, 2 - third]
            frame = np.column_stack([short, np.cross(way, short), way])
            yield _view(_thin(cloud, frame, n_points), obstacles, frame, None, 0.0)


def _even_axes(flat: FloatArray, height: FloatArray) -> FloatArray:
    """Principal axes (2, 2) of a footprint each of whose cells counts once, however densely it was seen.

    The cells lie along the axes of the points themselves, so that the result turns with the object.
    """
    axes = principal_axes(flat)
    own = flat @ axes
    return axes @ principal_axes(own[highest_in_cells(own, height, CELL)])


def highest_in_cells(xy: FloatArray, height: FloatArray, cell: float) -> NDArray[np.int64]:
    """Indices of the highest point in each square cell of the plane."""
    index = np.floor((xy - xy.min(axis=0)) / cell).astype(np.int64)
    rows, columns = (int(size) + 1 for size in index.max(axis=0))
    order = np.argsort(height)
    highest = np.full(rows * columns, -1, dtype=np.int64)
    highest[(index[:, 0] * columns + index[:, 1])[order]] = order  # the last one written, the highest, stays
    return highest[highest >= 0]


def _thin(cloud: FloatArray, axes: FloatArray, n_points: int) -> FloatArray:
    """A large cloud with one point left in each small box, 2.5 mm wide and 10 mm along the approach."""
    if len(cloud) <= n_points:
        return cloud
    local = cloud @ axes
    span = float(np.ptp(local, axis=0).max())
    size = np.array([1.0, 1.0, 4.0]) * max(BOX, span / 200)
    index = np.floor((local - local.min(axis=0)) / size).astype(np.int64)
    counts = index.max(axis=0) + 1
    key = (index[:, 0] * counts[1] + index[:, 1]) * counts[2] + index[:, 2]
    # The highest of a box, and not any, so that the choice does not depend on the order of the points.
    order = np.argsort(local[:, 2])
    kept = np.full(int(np.prod(counts)), -1, dtype=np.int64)
    kept[key[order]] = order
    return cloud[kept[kept >= 0]]


def _view(
    cloud: FloatArray,
    obstacles: FloatArray,
    axes: FloatArray,
    table_height: float | None,
    tilt: float,
) -> View:
    local = cloud @ axes
    middle = 0.5 * (local.min(axis=0) + local.max(axis=0))
    lowest = float(local[:, 2].min())
    # The origin lies at floor height where the table is level in this frame, else at the lowest point.
    middle[2] = lowest if table_height is None else table_height
    local = local - middle
    others = obstacles @ axes - middle
    # Only seen along the approach is a neighbour out of reach: however high it is, a hand could hit it.
    others = others[(np.abs(others[:, :2]) <= np.abs(local[:, :2]).max(axis=0) + REACHED).all(axis=1)]
    if len(others):
        others = others[highest_in_cells(others[:, :2], others[:, 2], OBSTACLE_CELL)]
    height = local[:, 2] if table_height is None else np.maximum(local[:, 2], 0.0)
    # Each 4 mm cell once, weighed by the height of what stands on it: independent of how densely it was seen.
    cells = highest_in_cells(local[:, :2], height, CELL)
    weight = np.maximum(height[cells], 0.003)
    centre = (weight[:, None] * local[cells, :2]).sum(axis=0) / weight.sum()
    return View(axes @ middle, axes, local[:, :2], height, others[:, :2], others[:, 2], 0.0, centre, tilt)


def _columns(cloud: FloatArray, height: FloatArray, up: FloatArray) -> FloatArray:
    """The object filled from its seen surface down to the table, in steps of about 1 cm."""
    steps = max(1, math.ceil(float(height.max()) / 0.01))
    shares = np.linspace(0.0, 1.0, steps + 1)
    return (cloud[None] - (shares[:, None] * height[None])[:, :, None] * up).reshape(-1, 3)


def _table_points(view: View, table_height: float, up: FloatArray) -> FloatArray:
    """A grid of points on the table under and around the object, as something that fingers must not touch."""
    radius = float(np.abs(view.xy).max()) + REACHED
    ticks = np.arange(-radius, radius, 2 * CELL)
    x, y = np.meshgrid(ticks, ticks)
    grid = view.origin + x.reshape(-1, 1) * view.axes[:, 0] + y.reshape(-1, 1) * view.axes[:, 1]
    return grid + (table_height - grid @ up)[:, None] * up


def _rotation(axis: int, angle: float) -> FloatArray:
    cos, sin = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = cos
    matrix[i, j], matrix[j, i] = -sin, sin
    return matrix
