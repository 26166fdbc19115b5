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


def relief(image: WorkingImage, plane: Float32Array, height: Float32Array) -> Relief:
    """Tell what stands on a table from the table. plane: (h, w) of the table's, 1/m, and height: (h, w) of the pixels
    above it, m.
    """
    q = image.inverse_depth
    measured = q > 0
    near = measured & (np.abs(height) < NEAR)
    bend, noise = _bend(q - plane, near)
    table = plane + bend
    above = np.where(measured, q - table, np.float32(0))
    mean = mean_of_nine(np.clip(above, -0.02, 0.02), measured)
    apart = np.abs(mean[::APART, ::APART])
    of_table = apart[near[::APART, ::APART] & (apart < 4 * noise)]
    level = max(1.4826 * float(np.median(of_table)), LEAST / 3) if len(of_table) else noise
    weak = measured & (mean > WEAK * level) & (above > OWN * noise) & (height > -NEAR)
    pieces, count = label_pieces(weak)
    at = np.flatnonzero(weak)
    piece = pieces.ravel()[at]
    over = np.clip(mean.ravel()[at] / np.float32(level) - np.float32(WEAK), np.float32(0), np.float32(MOST))
    enough = np.bincount(piece, over, minlength=count + 1) >= LEAST_MASS
    weak.ravel()[at] = enough[piece]
    return Relief(above, table, noise, weak)


def _bend(above: Float32Array, near: NDArray[np.bool_]) -> tuple[Float32Array, float]:
    """(h, w) by how much the table is nearer than its plane, 1/m, smoothly, and the σ of what is left."""
    h, w = above.shape
    across, down, every_term = _terms(h, w)
    at = np.flatnonzero(near[::EVERY, ::EVERY])
    terms = every_term.take(at, axis=0)
    seen = above[::EVERY, ::EVERY].ravel()[at].astype(np.float64)
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
    return np.zeros_like(above), NEAR / 6


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


def mean_of_nine(values: Float32Array, measured: NDArray[np.bool_]) -> Float32Array:
    """(h, w) the mean of the measured ones among a pixel and its eight neighbours."""
    if kernels.compiled is None:
        return mean_of_nine_reference(values, measured)
    mean = np.empty_like(values)
    kernels.compiled.mean_of_nine(values, measured, mean)
    return mean


def mean_of_nine_reference(values: Float32Array, measured: NDArray[np.bool_]) -> Float32Array:
    """`mean_of_nine` in NumPy."""
    total = _sum_of_nine(np.where(measured, values, np.float32(0)))
    return np.asarray(total / np.maximum(_sum_of_nine(measured.astype(np.float32)), np.float32(1)))


def _sum_of_nine(values: Float32Array) -> Float32Array:
    framed = np.pad(values, 1)
    rows = framed[:-2] + framed[1:-1] + framed[2:]
    return np.asarray(rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:])
