"""Pixels that hang in the air: single ones on edges, and ramps of several that a filter draws from an edge to what is
behind it. A ramp joins things that stand far apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels
from grasping.segmentation.lines_of_sight import LinesOfSight

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SAME_SURFACE = 0.02  # m: within this a neighbouring pixel sees the same surface
STEEP = 4.0  # times farther along the line of sight than across it, on both sides of a pixel: a ramp, or seen edge-on
LEAST_STEP = 0.010  # m, above the sensor's noise
UPRIGHT = 0.97  # m of fall a metre: what falls as steeply may be the side of a box, and joins nothing
WIDE = 2  # pixels at both sides
EDGE = 2  # pixels of a ramp that its object keeps: the edge is somewhere there
LEVEL = 0.4  # of the fall of the line of sight: what falls less is a top seen from low down


def single_pixels(points: NDArray, chosen: IntArray, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Which of the chosen points hang between two surfaces, as stereo and time of flight put them on edges.

    Fewer than two of such a pixel's eight neighbours are on the same surface. points (H · W, 3): the frame, in any
    frame of reference; chosen (C,) indexes it. Returns (C,).
    """
    if kernels.compiled is None or points.dtype.char not in "fd":
        return single_pixels_reference(points, chosen, shape)
    single = np.empty(len(chosen), dtype=bool)
    kernels.compiled.single_pixels(np.ascontiguousarray(points), chosen, shape[1], single)
    return single


def single_pixels_reference(points: NDArray, chosen: IntArray, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """`single_pixels` in NumPy."""
    columns = shape[1]
    left = [(-1, -1), (-1, 1), (0, -1), (1, -1), (1, 0), (1, 1)]
    flying = np.zeros(len(chosen), dtype=bool)
    close = _near(points, chosen, columns, 0, 1).astype(np.int8) + _near(points, chosen, columns, -1, 0)
    # The two that most pixels share a surface with decide for almost all of them.
    doubtful = np.flatnonzero(close < 2)
    close = close[doubtful]
    for row, step in left:
        close += _near(points, chosen[doubtful], columns, row, step)
    flying[doubtful] = close < 2
    return flying


def _near(points: NDArray, chosen: IntArray, columns: int, row: int, step: int) -> NDArray[np.bool_]:
    """(C,) whether the pixel so many rows and columns away is on the same surface as each of the chosen ones."""
    with np.errstate(over="ignore", invalid="ignore"):
        # Above the first row and below the last "clip" gives a corner of the image: far away, or oneself.
        apart = points.take(chosen + row * columns + step, axis=0, mode="clip") - points.take(chosen, axis=0)
        x, y, z = apart.T
        near = x * x + y * y + z * z < SAME_SURFACE**2
    if step:
        near &= chosen % columns != (columns - 1 if step > 0 else 0)
    return np.asarray(near)


def ramps(
    points: NDArray,
    distance: NDArray,
    chosen: IntArray,
    shape: tuple[int, int],
    sight: LinesOfSight,
    plane: FloatArray | None,
) -> NDArray[np.bool_]:
    """Which of the chosen points (C,) are on a ramp: between two surfaces, almost along the line of sight.

    points (H · W, 3), distance (H · W,): of all pixels from the camera, m, NaN for none. plane: (4,) the table; what is
    level or upright against it is no ramp: tops and sides seen edge-on.
    """
    found = np.zeros(len(chosen), dtype=bool)
    row = chosen // shape[1]
    directions = ((1, chosen - row * shape[1], shape[1]), (shape[1], row, shape[0]))
    for step, at, size in directions:
        steep, alike = _steep(distance, chosen, WIDE * step, WIDE * sight.pixel)
        between = np.flatnonzero(steep[0] & steep[1] & alike & (at >= WIDE) & (at < size - WIDE))
        if plane is not None:
            one, other = chosen[between] + WIDE * step, chosen[between] - WIDE * step
            with np.errstate(over="ignore", invalid="ignore"):
                fallen = (points.take(other, axis=0) - points.take(one, axis=0)) @ plane[:3]
                fall = fallen / (distance[one] - distance[other])
                drop = (sight.viewpoint - points.take(chosen[between], axis=0)) @ plane[:3] / distance[chosen[between]]
            between = between[(fall > LEVEL * drop) & (fall < UPRIGHT)]
        found[between] = True
    # Its ends are steep at one side only.
    ends = np.flatnonzero(_beside(found, chosen, shape) & ~found)
    for step, _, _ in directions:
        steep, _ = _steep(distance, chosen[ends], step, sight.pixel)
        found[ends[steep[0] ^ steep[1]]] = True
    return found


def _steep(
    distance: NDArray, chosen: IntArray, step: int, across: float
) -> tuple[tuple[NDArray[np.bool_], NDArray[np.bool_]], NDArray[np.bool_]]:
    """Whether it is steep from each pixel to the one a step ahead and to the one behind, and whether both rise alike.

    across: rad between them.
    """
    own = distance.take(chosen)
    with np.errstate(over="ignore", invalid="ignore"):
        ahead = distance.take(chosen + step, mode="clip") - own
        behind = own - distance.take(chosen - step, mode="clip")
        least = np.maximum(LEAST_STEP, STEEP * across * own)
        return (np.abs(ahead) > least, np.abs(behind) > least), ahead * behind > 0


def _beside(found: NDArray[np.bool_], chosen: IntArray, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(C,) which of the chosen pixels have one of those found among their four neighbours."""
    picture = np.zeros(shape[0] * shape[1] + 2 * shape[1], dtype=bool)  # a row more above and below
    at = chosen + shape[1]
    picture[at[found]] = True
    return picture[at + 1] | picture[at - 1] | picture[at + shape[1]] | picture[at - shape[1]]


def edge_owners(points: NDArray, objects: list[IntArray], on_ramps: IntArray, columns: int) -> IntArray:
    """The number (R,) of the object whose edge each pixel of a ramp is, −1 for none.

    An edge is two pixels wide, each on the same surface as one next to it. objects: pixels (M,) of each.
    """
    number = np.full(len(points), -1, dtype=np.int32)
    for each, index in enumerate(objects):
        number[index] = each
    owners = np.full(len(on_ramps), -1, dtype=np.int64)
    for _ in range(EDGE):
        left = np.flatnonzero(owners < 0)
        owners[left] = _beside_object(points, number, on_ramps[left], columns)
        number[on_ramps] = owners
    return owners


def _beside_object(points: NDArray, number: NDArray[np.int32], pixels: IntArray, columns: int) -> IntArray:
    owners = np.full(len(pixels), -1, dtype=np.int64)
    nearest = np.full(len(pixels), SAME_SURFACE**2)
    for step in (1, -1, columns, -columns):
        # Beyond a row's end stands the other end of the next: far away.
        there = number.take(pixels + step, mode="clip")
        owned = np.flatnonzero(there >= 0)
        beside = np.clip(pixels[owned] + step, 0, len(points) - 1)
        with np.errstate(over="ignore", invalid="ignore"):
            apart = points.take(beside, axis=0) - points.take(pixels[owned], axis=0)
            squared = np.einsum("ij,ij->i", apart, apart)
        closer = squared < nearest[owned]
        better = owned[closer]
        owners[better], nearest[better] = there[better], squared[closer]
    return owners
