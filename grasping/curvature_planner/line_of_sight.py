"""What the camera saw and what it did not: the depth image of an object, drawn again from its cloud.

A place is unknown where a seen surface, of the object or of a neighbour, stands between it and every viewpoint, or
where it lies on a line of sight on which nothing was measured. Everything else was looked through and is free.

`look` and `doubt` are the references of their compiled twins, which repeat their arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.geometry import exact_math

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Look = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray, float]]

PIXELS = 96  # on a side of the image
DRAWN = 6000  # points of the object that are drawn, or up to twice as many
AROUND = 0.05  # m around the object that the image shows
BEHIND = 0.006  # m behind a surface from which a place is hidden: less is the sensor's noise
BEHIND_ITSELF = 0.02  # m behind the nearest point of its pixel from which a point was not seen from there
COARSER = 3  # times that pixels are doubled for sparse clouds
TOGETHER = 7  # fifths of a neighbour that the pixels of a surface have in the mean, of two that are looked for
NEAREST = 1e-3  # m in front of the camera
HOLE_REACHES = 0.03  # m in front of the object's nearest point, from which on a line without a measurement is unknown

MOST_HIDDEN = 0.1  # share of a cloud's points that hide each other from where it was seen
LOWEST = 0.05  # m of a camera above what the object stands on
NARROWEST = math.cos(math.radians(50))  # of the cloud about the optical axis
CLOSEST = 0.1  # m


@dataclass(frozen=True)
class Sight:
    """V depth images, for the frame in which places are given.

    lenses: (V, 15), each the 3 × 3 rows and the offset (3,) that take a place of that frame into the camera's, and the
        image's left and upper edge and the pixels to a unit, all at depth 1.
    depth: (V, PIXELS, PIXELS) m of the nearest surface, inf where the camera looked past everything, and less than 0
        where nothing was measured: from that far on, without the sign, places are unknown.
    viewpoints: (V, 3) in the cloud's frame.
    """

    lenses: FloatArray
    depth: FloatArray
    viewpoints: FloatArray

    def within(self, axes: FloatArray, origin: FloatArray) -> Sight:
        """The same images for places given along axes (3, 3), by columns, from an origin."""
        lenses, turns = self.lenses.copy(), self.lenses[:, :9].reshape(-1, 3, 3)
        first, second, third = (turns[:, :, k, None] for k in range(3))
        lenses[:, :9] = ((first * axes[0] + second * axes[1]) + third * axes[2]).reshape(-1, 9)
        offset = (first * origin[0] + second * origin[1]) + third * origin[2]
        lenses[:, 9:12] = self.lenses[:, 9:12] + offset[:, :, 0]
        return Sight(lenses, self.depth, self.viewpoints)


NOTHING_KNOWN = Sight(np.empty((0, 15)), np.empty((0, PIXELS, PIXELS)), np.empty((0, 3)))


def sight_of(
    cloud: FloatArray,
    obstacles: FloatArray,
    viewpoints: FloatArray | None,
    unseen: FloatArray,
    up: FloatArray | None,
    table: FloatArray | None,
    look: Look,
) -> Sight:
    """What is known of a cloud (3, N) among obstacles (K, 3) from viewpoints (V, 3), or from its origin, if that fits.

    The origin is taken for the camera's place where the cloud lies in front of it, around the optical axis, where it is
    above what the object stands on, and where the cloud's points do not hide each other from there, as those of a whole
    model or of a merged cloud do. unseen: (U, 3), from the last of the viewpoints.
    """
    if cloud.shape[1] > 2 * DRAWN:  # more points than pixels show nothing more
        cloud = np.ascontiguousarray(cloud[:, :: cloud.shape[1] // DRAWN])
    others, rays = np.ascontiguousarray(obstacles), np.ascontiguousarray(unseen)
    if viewpoints is None or len(viewpoints) == 1:
        known = viewpoints is not None
        if not known and not _may_be_a_camera(cloud, up, table):
            return NOTHING_KNOWN
        eye = np.zeros((1, 3)) if viewpoints is None else viewpoints
        lens, depth, share = look(cloud, others, rays, eye[0])
        return Sight(lens[None], depth[None], eye) if known or share <= MOST_HIDDEN else NOTHING_KNOWN
    last = len(viewpoints) - 1
    images = [look(cloud, others, rays if k == last else rays[:0], eye) for k, eye in enumerate(viewpoints)]
    return Sight(np.array([lens for lens, *_ in images]), np.array([depth for _, depth, _ in images]), viewpoints)


def _may_be_a_camera(cloud: FloatArray, up: FloatArray | None, table: FloatArray | None) -> bool:
    """Whether a camera in the origin can have seen this cloud (3, N)."""
    low, high = cloud.min(axis=1), cloud.max(axis=1)
    middle = 0.5 * (low + high)
    distance = float(np.sqrt(middle @ middle))
    nearest = float(np.sqrt(np.square(np.maximum(np.maximum(low, -high), 0.0)).sum()))
    if nearest < CLOSEST or abs(float(middle[2])) < NARROWEST * distance:
        return False
    if table is not None:
        return float(table[3]) >= LOWEST
    return up is None or -float((up @ cloud).min()) >= LOWEST


def look(
    cloud: FloatArray, obstacles: FloatArray, unseen: FloatArray, viewpoint: FloatArray
) -> tuple[FloatArray, FloatArray, float]:
    """The depth image of a cloud (3, N) and of what is around it: (K, 3) surfaces, (U, 3) ends of lines without depth.

    Returns the lens (15,) and the depth of one of `Sight`'s images, and the share of the cloud's points that others of
    it hide. Pixels are as coarse as the cloud is sparse, and small gaps in a surface are closed.
    """
    low, high = cloud.min(axis=1), cloud.max(axis=1)
    turn = _towards(0.5 * (low + high) - viewpoint)
    x, y, z = _seen_from(cloud, turn, viewpoint)
    if not len(z):
        return np.zeros(15), np.full((PIXELS, PIXELS), np.inf), 0.0
    nearest = float(z.min())
    left, right, top, bottom = float(x.min()), float(x.max()), float(y.min()), float(y.max())
    size = (max(right - left, bottom - top) + 2.0 * AROUND / max(nearest, 0.05)) / PIXELS
    for _ in range(COARSER + 1):
        edges = (0.5 * (left + right) - 0.5 * PIXELS * size, 0.5 * (top + bottom) - 0.5 * PIXELS * size, 1.0 / size)
        pixel = _pixels(x, y, edges)
        depth = np.full(PIXELS * PIXELS + 1, np.inf)
        np.minimum.at(depth, pixel, z)
        if _hangs_together(np.isfinite(depth[:-1]).reshape(PIXELS, PIXELS)):
            break
        size *= 2.0
    share = float(np.count_nonzero(z > depth[pixel] + BEHIND_ITSELF)) / len(z)
    ox, oy, oz = _seen_from(obstacles.T, turn, viewpoint)
    np.minimum.at(depth, _pixels(ox, oy, edges), oz)
    image = _closed(depth[:-1].reshape(PIXELS, PIXELS))
    rx, ry, _ = _seen_from(unseen.T, turn, viewpoint)
    hole = np.zeros(PIXELS * PIXELS + 1, dtype=bool)
    hole[_pixels(rx, ry, edges)] = True
    image[hole[:-1].reshape(PIXELS, PIXELS) & np.isinf(image)] = min(HOLE_REACHES - nearest, -NEAREST)
    offset = [-float(exact_math.project(viewpoint[:, None], axis)[0]) for axis in turn]
    return np.array([*turn.reshape(-1), *offset, *edges]), image, share


def hidden(sight: Sight, x: FloatArray, y: FloatArray, height: FloatArray) -> BoolArray:
    """Whether places (arrays of one shape) were seen from none of the viewpoints. Without any, nothing is hidden."""
    return doubt(sight, x, y, height) > 0


def doubt(sight: Sight, x: FloatArray, y: FloatArray, height: FloatArray) -> NDArray[np.int64]:
    """How little is known of places (arrays of one shape): 0 looked through, 1 not measured, 2 behind a surface.

    Of several viewpoints the one that knows most counts.
    """
    found = np.full(x.shape, 2 if len(sight.lenses) else 0)
    for lens, depth in zip(sight.lenses, sight.depth, strict=True):
        place = [((lens[k] * x + lens[k + 1] * y) + lens[k + 2] * height) + lens[9 + k // 3] for k in (0, 3, 6)]
        ahead = place[2] > NEAREST
        z = np.where(ahead, place[2], 1.0)
        nearness = 1.0 / z
        pixel = _pixels(place[0] * nearness, place[1] * nearness, lens[12:])
        surface = np.append(depth, np.inf)[pixel]
        behind = ahead & (z > np.abs(surface) + BEHIND)
        found = np.minimum(found, np.where(behind, np.where(surface < 0.0, 1, 2), 0))
    return found


def _towards(forward: FloatArray) -> FloatArray:
    """(3, 3) rows: two directions across a line of sight, and along it."""
    x, y, z = forward.tolist()
    length = math.sqrt(x * x + y * y + z * z)
    if not length > 1e-9:
        return np.eye(3)
    x, y, z = x / length, y / length, z / length
    across = (0.0, -z, y) if abs(x) <= min(abs(y), abs(z)) else (z, 0.0, -x) if abs(y) <= abs(z) else (-y, x, 0.0)
    size = math.sqrt(across[0] * across[0] + across[1] * across[1] + across[2] * across[2])
    a, b, c = across[0] / size, across[1] / size, across[2] / size
    return np.array([[a, b, c], [y * c - z * b, z * a - x * c, x * b - y * a], [x, y, z]])


def _seen_from(
    points: FloatArray, turn: FloatArray, viewpoint: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where points (3, N) in front of the camera are in an image at depth 1, and their depth."""
    relative = points - viewpoint[:, None]
    x, y, z = (exact_math.project(relative, axis) for axis in turn)
    ahead = z > NEAREST
    z = z[ahead]
    return x[ahead] / z, y[ahead] / z, z


def _pixels(x: FloatArray, y: FloatArray, edges: tuple[float, float, float] | FloatArray) -> NDArray[np.int64]:
    """Index of the pixel of each place of the image; PIXELS² outside of it."""
    left, top, per = edges
    column, row = (x - left) * per, (y - top) * per
    inside = (column >= 0.0) & (column < PIXELS) & (row >= 0.0) & (row < PIXELS)
    index = np.where(inside, row, 0.0).astype(np.int64) * PIXELS + np.where(inside, column, 0.0).astype(np.int64)
    return np.where(inside, index, PIXELS * PIXELS)


def _hangs_together(taken: BoolArray) -> bool:
    """Whether taken pixels have enough others within two pixels to the right and below to be a surface."""
    right = taken[:-2, 1:-1] | taken[:-2, 2:]
    below = taken[1:-1, :-2] | taken[2:, :-2]
    taken = taken[:-2, :-2]  # around the object there is room
    return 5 * (int((taken & right).sum()) + int((taken & below).sum())) >= TOGETHER * int(taken.sum())


def _closed(depth: FloatArray) -> FloatArray:
    """Single pixels without a surface between two with one, across or else down, take the farther one's depth."""
    wide = np.pad(depth, 1, constant_values=np.inf)
    across = np.maximum(wide[1:-1, :-2], wide[1:-1, 2:])
    down = np.maximum(wide[:-2, 1:-1], wide[2:, 1:-1])
    return np.where(np.isfinite(depth), depth, np.where(np.isfinite(across), across, down))
