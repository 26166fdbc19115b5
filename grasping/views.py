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
    xy, height: the object's points in the frame, in rising height. obstacle_xy, obstacle_height: likewise what else is
        in the way.
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
    first = _cross(up, np.eye(3)[int(np.abs(up).argmin())])
    first /= math.sqrt(first @ first)
    level = np.column_stack([first, _cross(up, first), up])
    local = level.T @ cloud.T  # (3, N): sums and extremes over long rows are fast
    table_height = float(local[2].min()) if table is None else -float(table[3])
    axes = level @ _upright(principal_axes(local[:2].T)[:, 1])
    thinned = _thin(cloud, axes, n_points)
    axes = axes @ _upright(_short_side((axes[:, :2].T @ thinned.T).T))
    straight = _view(thinned, obstacles, axes, table_height, 0.0)
    yield straight
    if max_tilt <= 0.0:
        return
    tops = last_in_cells(straight.xy, BOX)
    tops = straight.origin + np.column_stack([straight.xy, straight.height])[tops] @ axes.T
    solid = np.asfortranarray(_columns(tops, np.maximum(tops @ up - table_height, 0.0), up))
    others = np.asfortranarray(np.vstack([obstacles, _table_points(straight, table_height, up)]))
    for angle in (0.5 * max_tilt, max_tilt):
        for about, sign in ((1, 1.0), (1, -1.0), (0, 1.0), (0, -1.0)):
            turned = axes @ _rotation(about, sign * angle)
            yield _view(_outermost(solid, turned), others, turned, None, angle)


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
            frame = np.column_stack([short, _cross(way, short), way])
            yield _view(_thin(cloud, frame, n_points), obstacles, frame, None, 0.0)


def _short_side(xy: FloatArray) -> FloatArray:
    """The direction (2,) across a footprint (N, 2) each of whose cells counts once, however densely it was seen.

    The cells lie along the axes of `xy`, which belong to the object: the result turns with it.
    """
    key, columns = _cells(xy, CELL)
    return principal_axes(np.column_stack(np.divmod(np.flatnonzero(np.bincount(key)), columns)).astype(np.float64))[
        :, 1
    ]


def last_in_cells(xy: FloatArray, cell: float) -> NDArray[np.int64]:
    """Indices of the last point in each square cell of the plane: the highest, of points in rising height."""
    key, _ = _cells(xy, cell)
    last = np.full(int(key.max()) + 1, -1, dtype=np.int64)
    last[key] = np.arange(len(xy))
    return last[last >= 0]


def _cells(xy: FloatArray, cell: float) -> tuple[NDArray[np.int64], int]:
    """The cell (N,) of the plane that each point lies in, counted by rows, and the number of columns."""
    index = ((xy - xy.min(axis=0)) / cell).astype(np.int64)
    columns = int(index[:, 1].max()) + 1
    return index[:, 0] * columns + index[:, 1], columns


def _centre(xy: FloatArray, height: FloatArray) -> FloatArray:
    """Estimate (2,) of the centre of mass from points in rising height.

    Each 4 mm cell counts once, by the height of what stands in it: independent of how densely it was seen.
    """
    key, columns = _cells(xy, CELL)
    highest = np.zeros(int(key.max()) + 1)
    highest[key] = np.maximum(height, 0.003)  # the last one written, the highest, stays
    cells = np.flatnonzero(highest)
    weight = highest[cells]
    first, second = np.divmod(cells, columns)
    return xy.min(axis=0) + CELL * (np.array([weight @ first, weight @ second]) / weight.sum() + 0.5)


def _thin(cloud: FloatArray, axes: FloatArray, n_points: int) -> FloatArray:
    """A large cloud with one point left in each small box, 2.5 mm wide and 10 mm along the approach."""
    if len(cloud) <= n_points:
        return cloud
    local = axes.T @ cloud.T
    low = local.min(axis=1, keepdims=True)
    span = float((local.max(axis=1, keepdims=True) - low).max())
    size = np.array([1.0, 1.0, 4.0])[:, None] * max(BOX, span / 200)
    index = ((local - low) / size).astype(np.int64)
    counts = index.max(axis=1) + 1
    key = (index[0] * counts[1] + index[1]) * counts[2] + index[2]
    # The highest of a box, and not any, so that the choice does not depend on the order of the points.
    order = np.argsort(local[2])
    kept = np.full(int(np.prod(counts)), -1, dtype=np.int64)
    kept[key[order]] = order
    return cloud[kept[kept >= 0]]


def _outermost(solid: FloatArray, axes: FloatArray) -> FloatArray:
    """Of a solid (N, 3) what can be seen along the third axis: one point in each cell of 2.5 mm."""
    local = axes.T @ solid.T
    order = np.argsort(local[2])
    return solid[order[last_in_cells(local[:2, order].T, BOX)]]


def _view(
    cloud: FloatArray,
    obstacles: FloatArray,
    axes: FloatArray,
    table_height: float | None,
    tilt: float,
) -> View:
    local = axes.T @ cloud.T
    local = np.take(local, np.argsort(local[2]), axis=1)
    middle = 0.5 * (local.min(axis=1) + local.max(axis=1))
    # The origin lies at floor height where the table is level in this frame, else at the lowest point.
    middle[2] = local[2, 0] if table_height is None else table_height
    local -= middle[:, None]
    if table_height is not None:
        np.maximum(local[2], 0.0, out=local[2])  # points under the table are noise of the table
    xy, height = local[:2].T, local[2]
    others = _in_reach(axes.T @ obstacles.T - middle[:, None], np.abs(local[:2]).max(axis=1) + REACHED)
    return View(axes @ middle, axes, xy, height, others[:, :2], others[:, 2], 0.0, _centre(xy, height), tilt)


def _in_reach(others: FloatArray, reach: FloatArray) -> FloatArray:
    """Of neighbours (3, K) the highest in each cell (k, 3), in rising height, within ± reach (2,) of the origin.

    Only seen along the approach is a neighbour out of reach: however high it is, a hand could hit it.
    """
    if not others.shape[1]:
        return others.T
    others = others[:, (np.abs(others[:2]) <= reach[:, None]).all(axis=0)]
    others = others[:, np.argsort(others[2])]
    if not others.shape[1]:
        return others.T
    return others[:, np.sort(last_in_cells(others[:2].T, OBSTACLE_CELL))].T


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


def _upright(short: FloatArray) -> FloatArray:
    """The turn (3, 3) about the third axis that brings the first one along `short` (2,)."""
    x, y = short
    return np.array([[x, -y, 0.0], [y, x, 0.0], [0.0, 0.0, 1.0]])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """np.cross of two vectors (3,) at a tenth of its price."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


def _rotation(axis: int, angle: float) -> FloatArray:
    cos, sin = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = cos
    matrix[i, j], matrix[j, i] = -sin, sin
    return matrix
