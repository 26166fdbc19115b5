"""The plane that the pixels around each pixel see, in inverse depth, where a plane is affine in column and row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.working_image import WorkingImage

Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]

MARGIN = 3
COARSE = [(row, column) for row in range(-2, 3) for column in range(-2, 3)]
# Every second pixel of 7×7 tells as much as all: neighbours' noise is alike.
FINE = [(row, column) for row in range(-3, 4) for column in range(-3, 4) if (row + column) % 2 == 0]
CONTINUOUS = 0.04  # 1/m: within this a neighbour may be on the same surface
CLOSE = 0.007  # 1/m from the first plane, to count for the second
FEWEST = 6  # pixels of a plane


@dataclass(frozen=True)
class SurfaceFits:
    """For each pixel of an image (h, w): inverse_depth of its plane there, 1/m; slopes (h, w, 2) of it along columns
    and rows, 1/m a pixel; normals (h, w, 3) towards the camera, in the cloud's frame. Zero where none was asked for.
    """

    inverse_depth: Float32Array
    slopes: Float32Array
    normals: Float32Array


def fit_surfaces(image: WorkingImage, asked: IntArray) -> SurfaceFits:
    """Fit a plane about each of the asked-for pixels (M,), indices of the flattened image."""
    to_frame = np.linalg.inv(image.rays).astype(np.float32)
    if kernels.compiled is None:
        return fit_surfaces_reference(image.inverse_depth, asked, to_frame)
    fits = _no_fits(image.shape)
    arrays = (fits.inverse_depth, fits.slopes, fits.normals)
    kernels.compiled.fit_surfaces(np.ascontiguousarray(image.inverse_depth), asked, to_frame, *arrays)
    return fits


def fit_surfaces_reference(inverse_depth: Float32Array, asked: IntArray, to_frame: Float32Array) -> SurfaceFits:
    """`fit_surfaces` in NumPy. to_frame: (3, 3), a plane's terms (along columns, along rows, at pixel 0) @ to_frame are
    along its normal in the cloud's frame.
    """
    h, w = inverse_depth.shape
    framed = np.zeros((h + 2 * MARGIN, w + 2 * MARGIN), dtype=np.float32)
    framed[MARGIN:-MARGIN, MARGIN:-MARGIN] = inverse_depth
    row, column = np.divmod(asked, w)
    planes = _fit_planes(framed, (row + MARGIN) * framed.shape[1] + column + MARGIN)
    fitted = inverse_depth.ravel()[asked] + planes[2]
    fits = _no_fits((h, w))
    fits.inverse_depth.reshape(-1)[asked] = fitted
    fits.slopes.reshape(-1, 2)[asked] = planes[:2].T
    fits.normals.reshape(-1, 3)[asked] = _normals(planes, fitted, row, column, to_frame)
    return fits


def _no_fits(shape: tuple[int, int]) -> SurfaceFits:
    return SurfaceFits(*(np.zeros((*shape, *axis), dtype=np.float32) for axis in ((), (2,), (3,))))


def _fit_planes(framed: Float32Array, at: IntArray) -> Float32Array:
    """(3, M) along columns, along rows, and at the pixel less its own inverse depth. framed: with a margin of zeros."""
    flat, width = framed.ravel(), framed.shape[1]
    own = flat[at]
    planes = np.zeros((3, len(at)), dtype=np.float32)
    for offsets, refined in ((COARSE, False), (FINE, True)):
        sums = np.zeros((9, len(at)), dtype=np.float32)
        for row, column in offsets:
            there = flat[at + (row * width + column)]
            apart = there - own
            if refined:
                expected = planes[2] + planes[0] * np.float32(column) + planes[1] * np.float32(row)
                near = (there > 0) & (np.abs(apart - expected) < np.float32(CLOSE))
            else:
                near = (there > 0) & (np.abs(apart) < np.float32(CONTINUOUS))
            weight = near.astype(np.float32)
            apart = np.where(near, apart, np.float32(0))
            for k, factor in enumerate((1, column, row, column * column, column * row, row * row)):
                sums[k] += weight * np.float32(factor)
            for k, factor in enumerate((1, column, row), start=6):
                sums[k] += apart * np.float32(factor)
        planes = _solve(sums)
    return planes


def _solve(sums: Float32Array) -> Float32Array:
    """Least squares from the sums of 1, c, r, cc, cr, rr, q, cq, rq."""
    n, c, r, cc, cr, rr, q, cq, rq = sums
    inverse = np.float32(1) / np.maximum(n, np.float32(1))
    mean_c, mean_r, mean_q = c * inverse, r * inverse, q * inverse
    cc, cr, rr = cc - c * mean_c, cr - c * mean_r, rr - r * mean_r
    cq, rq = cq - c * mean_q, rq - r * mean_q
    determinant = cc * rr - cr * cr
    good = (n >= FEWEST) & (determinant > 1)
    determinant = np.where(good, determinant, np.float32(1))
    along_c = np.where(good, (rr * cq - cr * rq) / determinant, np.float32(0))
    along_r = np.where(good, (cc * rq - cr * cq) / determinant, np.float32(0))
    return np.stack([along_c, along_r, mean_q - along_c * mean_c - along_r * mean_r])


def _normals(
    planes: Float32Array, fitted: Float32Array, row: IntArray, column: IntArray, to_frame: Float32Array
) -> Float32Array:
    """(M, 3) of length one towards the camera, in the cloud's frame."""
    at_origin = fitted - planes[0] * column.astype(np.float32) - planes[1] * row.astype(np.float32)
    away = [planes[0] * to_frame[0, k] + planes[1] * to_frame[1, k] + at_origin * to_frame[2, k] for k in range(3)]
    length = np.sqrt(away[0] * away[0] + away[1] * away[1] + away[2] * away[2])
    scale = np.float32(-1) / np.maximum(length, np.float32(1e-12))
    return np.stack([part * scale for part in away], axis=1)
