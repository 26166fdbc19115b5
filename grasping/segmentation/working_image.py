"""The image in which touching things are told apart: of one size whatever the camera's, in inverse depth.

In inverse depth a plane is exactly affine in the pixel's column and row, and the noise of a stereo camera is about the
same near and far. Half the pixels of a 640×480 frame tell as much as all of them, with half of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.lines_of_sight import LinesOfSight

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]

MOST_PIXELS = 110_000
ALIKE = 0.01  # 1/m: within this the pixels of a block see one surface
FEWEST = 100  # points of an image
LOOKS_DOWN = 0.95  # along a direction that is then none in the image
BEHIND, MOST_BEHIND = 0.05, 0.03  # 1/m, and the share of points so far behind others that no camera saw both
UNTOLD_BEHIND = 0.01  # likewise, where nobody said that a camera stood there: real ones have 0.0005 to 0.005
MOST_EMPTY = 0.05  # of the pixels between two filled ones, in a loose cloud's image


@dataclass(frozen=True)
class WorkingImage:
    """inverse_depth: (h, w), 1/m, 0 where nothing was measured. rays: (3, 3), a pixel (column, row, 1) looks along
    rays @ pixel, in the cloud's frame, and its point is viewpoint + rays @ pixel / inverse depth. pixel: rad between
    neighbours. cells: (N,) the pixel of each input point, −1 where it has none. point_inverse_depth: (N,) theirs, 1/m.
    """

    inverse_depth: Float32Array
    rays: FloatArray
    viewpoint: FloatArray
    pixel: float
    cells: NDArray[np.int32]
    point_inverse_depth: Float32Array

    @property
    def shape(self) -> tuple[int, int]:
        return self.inverse_depth.shape[0], self.inverse_depth.shape[1]

    @cached_property
    def pixel_a_point(self) -> bool:
        """Whether each input point is the pixel of its own number."""
        return np.array_equal(self.cells, np.arange(self.inverse_depth.size, dtype=np.int32))

    def plane_inverse_depth(self, plane: FloatArray) -> Float32Array:
        """(h, w) of a plane (4,), 1/m; negative where the line of sight leads away from it."""
        across, down = self.plane_terms(plane)
        return np.asarray(across + down[:, None])

    def plane_terms(self, plane: FloatArray) -> tuple[Float32Array, Float32Array]:
        """(w,) and (h,), 1/m: what columns and rows add to the inverse depth of a plane (4,)."""
        n, d = plane[:3], plane[3] + plane[:3] @ self.viewpoint
        column, row, one = -(n @ self.rays) / d
        h, w = self.shape
        return (column * np.arange(w)).astype(np.float32), (row * np.arange(h) + one).astype(np.float32)

    def positions(self) -> Float32Array:
        """(h, w, 3) of the pixels' points from the viewpoint, m; 0 where nothing was measured."""
        h, w = self.shape
        rays = self.rays.astype(np.float32)
        along = np.arange(w, dtype=np.float32)[:, None] * rays[:, 0]
        down = np.arange(h, dtype=np.float32)[:, None] * rays[:, 1] + rays[:, 2]
        return positions(self.inverse_depth, along, down)


def organised_image(
    points: NDArray, valid: NDArray[np.bool_], shape: tuple[int, int], sight: LinesOfSight
) -> WorkingImage:
    """Of an organised frame: blocks of so many pixels as leave at most `MOST_PIXELS`."""
    rows, columns = shape
    block = max(1, int(np.ceil(np.sqrt(rows * columns / MOST_PIXELS))))
    rays = sight.rays()
    depth_of = np.linalg.inv(rays)[2]
    q = inverse_depths(points, valid, depth_of, float(depth_of @ sight.viewpoint))
    h, w = rows // block, columns // block
    if block == 1:
        cells = np.arange(rows * columns, dtype=np.int32)
        image = q.reshape(shape)
    else:
        image = reduce_blocks(q.reshape(shape), block)
        down = np.minimum(np.arange(rows) // block, h - 1).astype(np.int32) * w
        cells = (down[:, None] + np.minimum(np.arange(columns) // block, w - 1).astype(np.int32)).reshape(-1)
    # The middle of a block, in pixels of the frame.
    grow = np.array([[block, 0, (block - 1) / 2], [0, block, (block - 1) / 2], [0, 0, 1]])
    return WorkingImage(image, rays @ grow, sight.viewpoint, sight.pixel * block, cells, q)


def loose_image(
    points: NDArray,
    valid: NDArray[np.bool_],
    viewpoint: FloatArray,
    up: FloatArray | None,
    most_behind: float = MOST_BEHIND,
) -> WorkingImage | None:
    """Of a loose cloud (N, 3) seen from a known viewpoint: an image as fine as its points are dense.

    None where the points surround the viewpoint, are too few, or cannot have been seen from there. up: (3,) where it is
    known, and upward in the image, too. most_behind: the share of points that may lie `BEHIND` others.
    """
    index = np.flatnonzero(valid)
    if len(index) < FEWEST:
        return None
    seen = points.take(index, axis=0).astype(np.float64) - viewpoint
    middle = np.median(seen, axis=0)
    length = float(np.linalg.norm(middle))
    if length < 1e-6:
        return None
    forward = middle / length
    down = np.array([0.0, 1.0, 0.0]) if up is None or abs(up @ forward) > LOOKS_DOWN else -up  # y down: a camera's
    if abs(down @ forward) > LOOKS_DOWN:
        down = np.array([1.0, 0.0, 0.0])
    side = np.cross(down, forward)
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(forward, side), forward])
    ahead = seen @ axes.T
    front = ahead[:, 2] > 0.1 * np.linalg.norm(seen, axis=1)
    index, ahead = index[front], ahead[front]
    if len(index) < 0.9 * np.count_nonzero(valid):
        return None
    flat = ahead[:, :2] / ahead[:, 2:]
    pitch = _density(flat)
    low = flat.min(axis=0)
    size = np.ceil((flat.max(axis=0) - low) / pitch).astype(np.int64) + 1
    if size.prod() > 4 * MOST_PIXELS:  # a few points far out: a coarser image
        pitch *= float(np.sqrt(size.prod() / (4 * MOST_PIXELS)))
        size = np.ceil((flat.max(axis=0) - low) / pitch).astype(np.int64) + 1
    at = ((flat - low) / pitch).astype(np.int64)
    w, h = int(size[0]), int(size[1])
    cell = at[:, 1] * w + at[:, 0]
    q = (1.0 / ahead[:, 2]).astype(np.float32)
    nearest = np.zeros(h * w, dtype=np.float32)
    np.maximum.at(nearest, cell, q)  # what lies nearer hides the rest
    behind = nearest[cell] - q
    if np.count_nonzero(behind > BEHIND) > most_behind * len(q):
        return None
    alike = behind < ALIKE
    sums = np.bincount(cell[alike], q[alike], minlength=h * w)
    counts = np.bincount(cell[alike], minlength=h * w)
    image = np.divide(sums, counts, out=np.zeros(h * w), where=counts > 0).astype(np.float32).reshape(h, w)
    cells = np.full(len(points), -1, dtype=np.int32)
    cells[index] = cell
    own = np.zeros(len(points), dtype=np.float32)
    own[index] = q
    to_flat = np.array([[pitch, 0, low[0] + pitch / 2], [0, pitch, low[1] + pitch / 2], [0, 0, 1]])
    return WorkingImage(image, axes.T @ to_flat, viewpoint, pitch, cells, own)


def positions(inverse_depth: Float32Array, along: Float32Array, down: Float32Array) -> Float32Array:
    """(h, w, 3), m, from what columns (w, 3) and rows (h, 3) add to the rays; 0 where nothing was measured."""
    if kernels.compiled is None:
        return positions_reference(inverse_depth, along, down)
    found = np.empty((*inverse_depth.shape, 3), dtype=np.float32)
    kernels.compiled.positions(np.ascontiguousarray(inverse_depth), along, down, found)
    return found


def positions_reference(inverse_depth: Float32Array, along: Float32Array, down: Float32Array) -> Float32Array:
    """`positions` in NumPy."""
    depth = np.divide(np.float32(1), inverse_depth, out=np.zeros_like(inverse_depth), where=inverse_depth > 0)
    return (along + down[:, None, :]) * depth[..., None]


def inverse_depths(
    points: NDArray, valid: NDArray[np.bool_], depth_of: FloatArray, camera_depth: float
) -> Float32Array:
    """(N,) 1/m of points (N, 3) float32 or float64, at depth_of @ point − camera_depth; 0 where one is not valid."""
    if kernels.compiled is None or points.dtype.char not in "fd":
        return inverse_depths_reference(points, valid, depth_of, camera_depth)
    q = np.empty(len(points), dtype=np.float32)
    kernels.compiled.inverse_depths(np.ascontiguousarray(points), valid, *depth_of.tolist(), camera_depth, q)
    return q


def inverse_depths_reference(
    points: NDArray, valid: NDArray[np.bool_], depth_of: FloatArray, camera_depth: float
) -> Float32Array:
    """`inverse_depths` in NumPy, in the points' own precision."""
    along = depth_of.astype(points.dtype)
    x, y, z = points.T
    with np.errstate(over="ignore", invalid="ignore"):
        depth = along[0] * x + along[1] * y + along[2] * z
        depth -= points.dtype.type(camera_depth)
    q = np.zeros(len(points), dtype=np.float32)
    np.divide(1.0, depth, out=q, where=valid & (depth > 1e-6), casting="same_kind")
    return q


def reduce_blocks(q: Float32Array, block: int) -> Float32Array:
    """(H // block, W // block): the mean of what lies about each block's median; 0 where half was not measured."""
    if kernels.compiled is not None:
        reduced = np.empty((q.shape[0] // block, q.shape[1] // block), dtype=np.float32)
        kernels.compiled.reduce_blocks(np.ascontiguousarray(q), block, reduced)
        return reduced
    return reduce_blocks_reference(q, block)


def reduce_blocks_reference(q: Float32Array, block: int) -> Float32Array:
    """`reduce_blocks` in NumPy."""
    h, w = q.shape[0] // block, q.shape[1] // block
    cut = q[: h * block, : w * block].reshape(h, block, w, block).transpose(0, 2, 1, 3)
    ordered = np.sort(cut.reshape(h * w, block * block), axis=1)
    measured = np.count_nonzero(ordered > 0, axis=1)
    last = block * block - 1
    median = ordered[np.arange(h * w), np.minimum(last - (measured - 1) // 2, last)]
    near = (np.abs(ordered - median[:, None]) < np.float32(ALIKE)) & (ordered > 0)
    total, count = np.zeros(h * w, dtype=np.float32), np.zeros(h * w, dtype=np.float32)
    for column in range(block * block):  # in the order in which C adds
        total += np.where(near[:, column], ordered[:, column], np.float32(0))
        count += near[:, column]
    mean = total / np.maximum(count, np.float32(1))
    return np.where(2 * measured >= block * block, mean, np.float32(0)).reshape(h, w)


def _density(flat: FloatArray) -> float:
    """The finest width of a pixel with which hardly a pixel between filled ones is empty, for points (N, 2)."""
    low = flat.min(axis=0)
    spread = np.ptp(flat, axis=0)
    pitch = max(float(np.sqrt(spread.prod() / len(flat))) / 2, float(spread.max()) / 4000, 1e-9)
    for _ in range(24):
        at = ((flat - low) / pitch).astype(np.int64)
        columns, rows = at.max(axis=0) + 1
        filled = np.zeros((rows, columns), dtype=bool)
        filled[at[:, 1], at[:, 0]] = True
        inside = filled[:, :-2] & filled[:, 2:]
        empty = np.count_nonzero(inside & ~filled[:, 1:-1])
        if empty <= MOST_EMPTY * np.count_nonzero(inside) and np.count_nonzero(filled) <= MOST_PIXELS:
            break
        pitch *= 1.1
    return pitch
