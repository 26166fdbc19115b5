"""What stands out of the table: by more than the table's own noise, once the sensor's bending of it is taken off.

A real table is no plane to a camera: lens and projector bend it by up to a centimetre, smoothly. A cubic surface
takes that off, and what is left is the noise, from which flat things then stand out that a band about a plane swallows.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.pieces import label_pieces
from grasping.segmentation.working_image import WorkingImage

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

NEAR = 0.02  # m from the plane, within which a pixel may be the table's
ORDER = 3  # of the surface that bends the plane
POWERS = tuple((i, j) for i in range(ORDER + 1) for j in range(ORDER + 1 - i))  # of row and column
EVERY = 6  # pixels along rows and columns, of which one says how the table bends
LEAST = 0.0012  # 1/m: of the noise; a perfect sensor's is not taken at its word
FEWEST = 100  # pixels of the table that say how it bends
MOST_ABOVE = 0.02  # 1/m of a pixel that counts for the mean of 3×3
WEAK = 2.0  # times the noise of the mean of 3×3 pixels, above which a pixel may be a thing's
OWN = 1.75  # times a pixel's own noise, likewise
APART = 3  # pixels between means that have no pixel in common
MOST = 8.0  # times that noise over `WEAK` that a pixel counts for
LEAST_MASS = 80.0  # of what pixels that hang together count for: few that stand out far, or many that do a little


@dataclass(frozen=True)
class Relief:
    """above: (h, w), 1/m, each pixel's inverse depth less the table's. table: (h, w), 1/m, the table's. noise: σ of
    the table's pixels, 1/m. stands_out: (h, w) what is no table and lies above it.
    """

    above: Float32Array
    table: Float32Array
    noise: float
    stands_out: NDArray[np.bool_]


def heights_over(image: WorkingImage, plane: FloatArray) -> tuple[Float32Array, Float32Array]:
    """(h, w) of a plane (4,) its inverse depth in each pixel, 1/m, and how far the pixel is above it, m."""
    camera = np.float32(plane[3] + plane[:3] @ image.viewpoint)
    if kernels.compiled is None:
        level = image.plane_inverse_depth(plane)
        # Along a line of sight the height falls from the camera's evenly with the depth.
        measured = image.inverse_depth > 0
        share = np.divide(level, image.inverse_depth, out=np.zeros(image.shape, dtype=np.float32), where=measured)
        return level, camera * (np.float32(1) - share)
    level, height = np.empty_like(image.inverse_depth), np.empty_like(image.inverse_depth)
    kernels.compiled.find_heights(image.inverse_depth, *image.plane_terms(plane), float(camera), level, height)
    return level, height


def relief(image: WorkingImage, plane: Float32Array, height: Float32Array) -> Relief:
    """Tell what stands on a table from the table. plane: (h, w) of the table's, 1/m, and height: (h, w) of the pixels
    above it, m.
    """
    q = image.inverse_depth
    bend, noise = _bend(q, plane, height)
    table, above = rise_over_table(q, plane, bend)
    mean = mean_of_nine(above, q, MOST_ABOVE)
    some = np.s_[::APART, ::APART]
    apart = np.abs(mean[some])
    of_table = apart[_near(q[some], height[some]) & (apart < 4 * noise)]
    level = max(1.4826 * float(np.median(of_table)), LEAST / 3) if len(of_table) else noise
    return Relief(above, table, noise, stand_out(q, above, mean, height, noise, level))


def _near(q: Float32Array, height: Float32Array) -> NDArray[np.bool_]:
    return np.asarray((q > 0) & (np.abs(height) < NEAR))


def rise_over_table(q: Float32Array, plane: Float32Array, bend: Float32Array) -> tuple[Float32Array, Float32Array]:
    """(h, w), 1/m: the bent table, and by how much a pixel is nearer than it, 0 where nothing was measured."""
    if kernels.compiled is None:
        table = plane + bend
        return table, np.where(q > 0, q - table, np.float32(0))
    table, above = np.empty_like(q), np.empty_like(q)
    kernels.compiled.rise_over_table(q, plane, bend, table, above)
    return table, above


def stand_out(
    q: Float32Array, above: Float32Array, mean: Float32Array, height: Float32Array, noise: float, level: float
) -> NDArray[np.bool_]:
    """(h, w): which pixels hang together that are enough above the table. level: the noise of the means of nine."""
    if kernels.compiled is None:
        return stand_out_reference(q, above, mean, height, noise, level)
    found = np.empty(q.shape, dtype=bool)
    kernels.compiled.stand_out(q, above, mean, height, OWN * noise, WEAK * level, -NEAR, level, found)
    return found


def stand_out_reference(
    q: Float32Array, above: Float32Array, mean: Float32Array, height: Float32Array, noise: float, level: float
) -> NDArray[np.bool_]:
    """`stand_out` in NumPy."""
    weak = (q > 0) & (mean > WEAK * level) & (above > OWN * noise) & (height > -NEAR)
    pieces, count = label_pieces(weak)
    at = np.flatnonzero(weak)
    piece = pieces.ravel()[at]
    over = np.clip(mean.ravel()[at] / np.float32(level) - np.float32(WEAK), np.float32(0), np.float32(MOST))
    enough = np.bincount(piece, over, minlength=count + 1) >= LEAST_MASS
    weak.ravel()[at] = enough[piece]
    return np.asarray(weak)


def _bend(q: Float32Array, plane: Float32Array, height: Float32Array) -> tuple[Float32Array, float]:
    """(h, w) by how much the table is nearer than its plane, 1/m, smoothly, and the σ of what is left."""
    h, w = q.shape
    across, down, every_term = _terms(h, w)
    some = np.s_[::EVERY, ::EVERY]
    at = np.flatnonzero(_near(q[some], height[some]))
    terms = every_term.take(at, axis=0)
    seen = (q[some] - plane[some]).ravel()[at].astype(np.float64)
    factors, limit = np.zeros(len(POWERS)), NEAR
    left, last = seen, at[:0]
    for _ in range(6):
        inside = np.flatnonzero(np.abs(left) < limit)
        if len(inside) < FEWEST:
            break
        if np.array_equal(inside, last):
            continue  # the same pixels, the same surface
        last = inside
        used = terms.take(inside, axis=0)
        # A little of a ridge: where no table is seen nothing is claimed.
        normal = used.T @ used + 1e-4 * len(used) * np.eye(len(POWERS))
        factors = np.linalg.solve(normal, used.T @ seen[inside])
        left = seen - terms @ factors
        limit = max(3 * 1.4826 * float(np.median(np.abs(left[inside]))), 3 * LEAST)
    else:
        grid = np.zeros((ORDER + 1, ORDER + 1))
        for (i, j), factor in zip(POWERS, factors, strict=True):
            grid[i, j] = factor
        return (down.astype(np.float32) @ (grid @ across.T).astype(np.float32)), limit / 3
    return np.zeros_like(q), NEAR / 6


@lru_cache(maxsize=4)
def _terms(h: int, w: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Powers (w, 4) of columns, and (h, 4) of rows, from −1 to 1; and the surface's terms (K, 10) at each `EVERY`-th
    pixel of both.
    """
    across = np.linspace(-1, 1, w)[:, None] ** np.arange(ORDER + 1)
    down = np.linspace(-1, 1, h)[:, None] ** np.arange(ORDER + 1)
    of_row, of_column = np.array(POWERS).T
    terms = down[::EVERY, None, of_row] * across[None, ::EVERY, of_column]
    return across, down, np.ascontiguousarray(terms.reshape(-1, len(POWERS)))


def mean_of_nine(values: Float32Array, q: Float32Array, most: float) -> Float32Array:
    """(h, w) the mean of those of a pixel and its eight neighbours that were measured (q > 0), none of which counts for
    more than `most`.
    """
    if kernels.compiled is None:
        return mean_of_nine_reference(values, q, most)
    mean = np.empty_like(values)
    kernels.compiled.mean_of_nine(values, q, most, mean)
    return mean


def mean_of_nine_reference(values: Float32Array, q: Float32Array, most: float) -> Float32Array:
    """`mean_of_nine` in NumPy."""
    measured = q > 0
    total = _sum_of_nine(np.where(measured, np.clip(values, -np.float32(most), np.float32(most)), np.float32(0)))
    return np.asarray(total / np.maximum(_sum_of_nine(measured.astype(np.float32)), np.float32(1)))


def _sum_of_nine(values: Float32Array) -> Float32Array:
    framed = np.pad(values, 1)
    rows = framed[:-2] + framed[1:-1] + framed[2:]
    return np.asarray(rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:])
