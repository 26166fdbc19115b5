"""From where the gripper may come: over a table straight down or tilted; without one from the camera's side.

Where no camera is known either, along the cloud's own axes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.approach_view import ApproachView
from grasping.curvature_planner.backend import Backend
from grasping.curvature_planner.line_of_sight import Sight
from grasping.curvature_planner.projection import last_in_cells
from grasping.geometry import exact_math
from grasping.geometry.principal_axes import principal_axes

FloatArray = NDArray[np.float64]

REACHED = 0.08  # m beyond the object in which neighbours matter
CELL = 0.004  # m, in which a footprint is weighed
OBSTACLE_CELL = 0.003  # m, to which neighbours are thinned
BOX, BOX_DEPTH = 0.0025, 4.0  # m, to which large clouds are thinned; and times that along the approach
FROM_THE_CAMERA = math.cos(math.radians(45))
_NOTHING = np.empty((3, 0))


def approaches_from_above(
    cloud: FloatArray,
    up: FloatArray,
    table: FloatArray | None,
    obstacles: FloatArray,
    n_points: int,
    max_tilt: float,
    backend: Backend,
    sight: Sight,
) -> Iterator[ApproachView]:
    """Straight down first; then, drawn only when asked for, tilted by `max_tilt` about the footprint's axes.

    cloud: (3, N). sight: what the camera saw, for places in the cloud's frame.
    """
    first = _cross(up, np.eye(3)[int(np.abs(up).argmin())])
    first /= math.sqrt(first @ first)
    level = np.ascontiguousarray(np.array([first, _cross(up, first), up]).T)
    table_height = float(exact_math.project(cloud, up).min()) if table is None else -float(table[3])
    axes = level @ _upright(*backend.short_side(cloud, level, 0.0))
    thinned = cloud if cloud.shape[1] <= n_points else backend.thin(cloud, axes, BOX, BOX_DEPTH)
    whole = backend.with_its_back(thinned, up, table_height, BOX, sight)
    axes = axes @ _upright(*backend.short_side(whole, axes, CELL))
    straight = _view(whole, thinned, obstacles, axes, table_height, 0.0, backend, sight)
    yield straight
    if max_tilt <= 0.0:
        return
    x, y, _ = straight.points
    tops = straight.origin + straight.points.T[last_in_cells(x, y, BOX)] @ axes.T
    solid = _columns(tops, np.maximum(tops @ up - table_height, 0.0), up)
    others = np.vstack([obstacles, _table_points(straight, table_height, up)])
    for angle in (0.5 * max_tilt, max_tilt):
        for about, sign in ((1, 1.0), (1, -1.0), (0, 1.0), (0, -1.0)):
            turned = axes @ _rotation(about, sign * angle)
            seen = backend.thin(solid, turned, BOX, math.inf)
            yield _view(seen, thinned, others, turned, None, angle, backend, sight)


def approaches_without_table(
    cloud: FloatArray, obstacles: FloatArray, n_points: int, backend: Backend, sight: Sight
) -> Iterator[ApproachView]:
    """Approaches from the camera's side: along the cloud's own third and second axis, where those are within 45° of the
    line of sight, and along that. Without a camera along either axis, first from the side to which the cloud bulges.

    cloud: (3, N). sight: as for `approaches_from_above`.
    """
    long, second, _ = principal_axes(cloud.T).T
    third = _cross(second, long)
    centred = cloud - cloud.mean(axis=1, keepdims=True)
    ways: list[tuple[FloatArray, FloatArray]] = []
    if len(sight.viewpoints):
        towards = sight.viewpoints.mean(axis=0) - cloud.mean(axis=1)
        towards /= math.sqrt(towards @ towards)
        for against, short in ((third, second), (second, third)):
            cosine = float(against @ towards)
            if abs(cosine) > FROM_THE_CAMERA:
                ways.append((against * math.copysign(1.0, cosine), short))
        short = _cross(towards, long if abs(float(long @ towards)) < FROM_THE_CAMERA else second)
        ways.append((towards, short / math.sqrt(short @ short)))
    else:
        for against, short in ((third, second), (second, third)):
            depth = against @ centred
            # Few points lie far behind a bulging surface: the tail of the distribution shows the way in.
            against = against if float((depth * depth * depth).sum()) < 0.0 else -against
            ways += [(against, short), (-against, short)]
    for upward, short in ways:
        frame = np.array([short, _cross(upward, short), upward]).T
        thinned = cloud if cloud.shape[1] <= n_points else backend.thin(cloud, frame, BOX, BOX_DEPTH)
        lowest = float(exact_math.project(thinned, upward).min())
        whole = backend.with_its_back(thinned, upward, lowest, BOX, sight)
        yield _view(whole, thinned, obstacles, frame, None, 0.0, backend, sight)


def _view(
    cloud: FloatArray,
    measured: FloatArray,
    obstacles: FloatArray,
    axes: FloatArray,
    table_height: float | None,
    tilt: float,
    backend: Backend,
    sight: Sight,
) -> ApproachView:
    points, middle, centre, footprint = backend.place(cloud, axes, table_height, CELL)
    others = _NOTHING
    if len(obstacles):
        reach = np.abs(points[:2]).max(axis=1) + REACHED
        others = backend.neighbours(obstacles, axes, middle, reach, OBSTACLE_CELL)
    told_apart = None if measured is cloud else measured
    return ApproachView(axes @ middle, axes, points, others, 0.0, centre, tilt, sight, told_apart, *footprint)


def _columns(cloud: FloatArray, height: FloatArray, up: FloatArray) -> FloatArray:
    """The object (N, 3) filled from its seen surface down to the table, in steps of about 1 cm: (3, M)."""
    steps = max(1, math.ceil(float(height.max()) / 0.01))
    shares = np.linspace(0.0, 1.0, steps + 1)
    filled = cloud[None] - (shares[:, None] * height[None])[:, :, None] * up
    return np.ascontiguousarray(filled.reshape(-1, 3).T)


def _table_points(view: ApproachView, table_height: float, up: FloatArray) -> FloatArray:
    """A grid of points on the table under and around the object, as something that fingers must not touch."""
    radius = float(np.abs(view.points[:2]).max()) + REACHED
    ticks = np.arange(-radius, radius, 2 * CELL)
    x, y = np.meshgrid(ticks, ticks)
    grid = view.origin + x.reshape(-1, 1) * view.axes[:, 0] + y.reshape(-1, 1) * view.axes[:, 1]
    return grid + (table_height - grid @ up)[:, None] * up


def _upright(x: float, y: float) -> FloatArray:
    """The turn (3, 3) about the third axis that brings the first one along a direction in the plane."""
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
