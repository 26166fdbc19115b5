"""The back of an object that was seen from one side: assumed from symmetry, where nothing seen speaks against it.

Things that stand on a table are mostly as good as unchanged by half a turn about a line that points up: boxes, bottles,
cans, bowls. So the seen surface, turned so, is taken for the unseen one, where the camera could not look. The line goes
through the middle of what was seen, or as far behind that as a body as deep as it is wide and high allows: the farthest
place from which hardly anything of the turned surface would have been seen in front of what was. What is hidden between
surfaces, seen or assumed, is inside.

`with_its_back` is the reference of its compiled twin, which repeats its arithmetic.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.line_of_sight import Sight, hidden
from grasping.geometry import exact_math

FloatArray = NDArray[np.float64]

MOST_CELLS = 120  # of the footprint along either side
TRIED = 6  # places of the line
AGREES = 0.010  # m below a turned surface at which a seen one is still its like
BELOW = 0.005  # m below its top at which a turned surface must be hidden
MOST_SEEN = 10  # of as many turned cells one may lie where the camera looked through
STEP = 0.010  # m by which a place is lowered until it is hidden
LEAST_HEIGHT = 0.005  # m above the floor
NO_FINGER_ENTERS = 0.010  # m: narrower gaps stay
FILLED = 0.0075  # m between the places that stand for the inside: closer than a finger is wide
ABOVE = 0.2  # of the way to the object that a camera must be level with it: from above there is no back


def with_its_back(cloud: FloatArray, up: FloatArray, floor: float, cell: float, sight: Sight) -> FloatArray:
    """A cloud (3, N) and what is assumed of its far side and its inside (3, M), if it was seen from a side.

    floor: height along `up` of what it stands on, m. cell: of the map that is turned, m, or an image's pixel there.
    """
    if not len(sight.lenses):
        return cloud
    eye = [exact_math.total(row) / len(sight.viewpoints) for row in sight.viewpoints.T]
    low, high = cloud.min(axis=1).tolist(), cloud.max(axis=1).tolist()
    along = [0.5 * (a + b) - c for a, b, c in zip(low, high, eye, strict=True)]
    upward = up.tolist()
    distance, sinking = math.sqrt(_dot(along, along)), _dot(along, upward)
    level = [a - sinking * u for a, u in zip(along, upward, strict=True)]
    size = math.sqrt(_dot(level, level))
    if size <= ABOVE * distance:
        return cloud
    (b0, b1, b2), (u0, u1, u2) = (each / size for each in level), upward
    axes = np.array([[b1 * u2 - b2 * u1, b0, u0], [b2 * u0 - b0 * u2, b1, u1], [b0 * u1 - b1 * u0, b2, u2]])
    cell = max(cell, distance / float(sight.lenses[:, 14].min()))
    image_up = (-sinking / distance, size / distance)
    found = _assume_back(cloud, axes, floor, image_up, cell, sight.within(axes, np.zeros(3))).T
    return np.concatenate([cloud, [exact_math.project(found, row) for row in axes]], axis=1) if found.size else cloud


def _dot(a: list[float], b: list[float]) -> float:
    return (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]


def _assume_back(
    cloud: FloatArray, axes: FloatArray, floor: float, image_up: tuple[float, float], cell: float, sight: Sight
) -> FloatArray:
    """Places (M, 3), along the axes, of an assumed surface and of what is inside.

    cloud: (3, N). axes: (3, 3), by columns across the line of sight, along it, and up; sight: for places along them.
    floor: along the third. image_up: the second and third coordinate of the direction up in the image. cell: m.
    """
    x, y, height = (exact_math.project(cloud, axis) for axis in axes.T)
    x0, y0 = float(x.min()), float(y.min())
    wide, long = float(x.max()) - x0, float(y.max()) - y0
    upward = image_up[0] * y + image_up[1] * height
    deep = min(wide, float(upward.max()) - float(upward.min()))
    cell = max(cell, max(wide, long) / MOST_CELLS)
    columns, lines = int(wide / cell) + 1, int(long / cell) + 1
    column = np.minimum(((x - x0) / cell).astype(np.int64), columns - 1)
    line = np.minimum(((y - y0) / cell).astype(np.int64), lines - 1)
    top = np.full(lines * columns, -1, dtype=np.int64)
    order = np.argsort(height, kind="stable")
    top[(line * columns + column)[order]] = order  # the last one written, the highest, stays
    taken = np.flatnonzero(top >= 0)
    top = top[taken]
    line, column = np.divmod(taken, columns)
    last = _turned_about(line, column, height[top], (lines, columns), int(deep / cell), (x0, y0, cell), sight)
    surface = np.full((last + 1, columns), -np.inf)
    surface[line, column] = height[top]
    seen = surface.copy()
    found: list[tuple[float, float, float]] = []
    at_x = (2.0 * x0 + columns * cell) - x[top]
    at_y = (2.0 * y0 + (last + 1) * cell) - y[top]
    for i, j, px, py, h in zip(
        line.tolist(), column.tolist(), at_x.tolist(), at_y.tolist(), height[top].tolist(), strict=True
    ):
        if seen[last - i, columns - 1 - j] == -np.inf:
            under = _lowered(px, py, h, floor, sight)
            if under > -np.inf:
                found.append((px, py, under))
                surface[last - i, columns - 1 - j] = under
    stride, least = max(1, int(FILLED / cell)), max(2, int(NO_FINGER_ENTERS / cell))
    inside = [(0, k, stride) for k in range(stride // 2, columns, stride)]
    inside += [(1, k, stride) for k in range(stride // 2, last + 1, stride)]
    for along, k, step in [(0, 0, 1), (0, columns - 1, 1), *inside]:  # the sides densely: pads may touch them
        row = surface[:, k] if along == 0 else surface[k]
        for one, other in pairwise(np.flatnonzero(row > -np.inf).tolist()):
            if other - one - 1 < least:
                continue
            h = max(float(row[one]), float(row[other]))
            between = []
            for m in range(one + step, other, step):
                i, j = (m, k) if along == 0 else (k, m)
                px, py = x0 + (j + 0.5) * cell, y0 + (i + 0.5) * cell
                under = _lowered(px, py, h, floor, sight)
                if under == -np.inf:
                    break
                between.append((px, py, under))
            else:
                found += between
    return np.array(found).reshape(-1, 3)


def _turned_about(
    line: NDArray[np.int64],
    column: NDArray[np.int64],
    height: FloatArray,
    shape: tuple[int, int],
    deep: int,
    corner: tuple[float, float, float],
    sight: Sight,
) -> int:
    """Line to which the first line is turned: of the middle of what was seen, or of one farther back."""
    near = shape[0] - 1
    far = max(near, deep)
    if far == near:
        return near
    x0, y0, cell = corner
    seen = np.full(shape, -np.inf)
    seen[line, column] = height
    x = x0 + ((shape[1] - 1 - column) + 0.5) * cell
    for k in range(TRIED):
        last = far - (far - near) * k // TRIED
        turned = last - line
        like = np.where(turned < shape[0], seen[np.minimum(turned, near), shape[1] - 1 - column], -np.inf)
        y = y0 + (turned + 0.5) * cell
        places = (np.asarray(each, dtype=np.float64) for each in (x, y, height - BELOW))
        fits = (like >= height - AGREES) | hidden(sight, *places)
        if MOST_SEEN * (len(line) - int(np.count_nonzero(fits))) <= len(line):
            return last
    return near


def _lowered(x: float, y: float, height: float, floor: float, sight: Sight) -> float:
    """The height at and below this one, in steps, at which a place is hidden; −inf where that is above no floor."""
    steps = np.arange(max(0, math.ceil((height - floor) / STEP)) + 1, dtype=np.float64)
    tried: FloatArray = height - STEP * steps
    tried = tried[tried > floor + LEAST_HEIGHT]
    found = np.flatnonzero(hidden(sight, np.full_like(tried, x), np.full_like(tried, y), tried))
    return float(tried[found[0]]) if len(found) else -math.inf
