"""Along which line each pixel of an organised frame looks, and what of an object's surroundings it did not measure.

A pixel without depth has no point, yet its line of sight is known: the other pixels say how the camera is made.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SAMPLED = 160  # pixels that suffice to measure eight numbers
JUDGED = 2000  # pixels among which enough lie off the frame's plane, where there is one
OFF_PLANE = 0.02  # of a point's distance: seen from another place, it would lie that far from its line, rad
FEWEST = 20  # pixels with depth, below which the camera is not measured
MOST_ERROR = 0.003  # rad; nine of ten pixels look along their line to within this, else the viewpoint is another
PLANE_ROUNDS, IN_ROUNDS = 6, 500  # of a fit to the half that lies nearest to the plane before; points that suffice
BESIDE = 0.015  # m around an object's outline within which a hole that begins at it belongs to it


class LinesOfSight:
    """The pinhole camera of an organised frame (H, W), measured on its points.

    `fits` says whether the points lie along straight lines from the viewpoint, in the order of their pixels. Those of
    one plane do so from any viewpoint, as two pictures of a plane are a homography apart (Hartley and Zisserman, ch.
    13): so what lies off the plane has to, as well. pixel: the angle between the lines of two neighbours in the middle
    of the image, rad.
    """

    def __init__(
        self, points: NDArray, valid: NDArray[np.bool_], shape: tuple[int, int], viewpoint: FloatArray
    ) -> None:
        self.shape, self.viewpoint, self.fits, self.pixel = shape, viewpoint, False, 0.0
        self._scale = 2.0 / max(shape)
        index = np.flatnonzero(valid)
        if len(index) < FEWEST:
            return
        judged, towards = _evenly(points, index, JUDGED, viewpoint)
        index, seen = _evenly(points, index, SAMPLED, viewpoint)
        if len(index) < FEWEST:
            return
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        # A pixel (column, row, 1) looks along A · pixel: their cross product is zero, linear in A's nine numbers.
        pixels = self._pixels(index)
        x, y, z = seen.T[:, :, None]
        rows = np.zeros((3, len(index), 9))
        rows[0, :, 3:6], rows[0, :, 6:] = -z * pixels, y * pixels
        rows[1, :, :3], rows[1, :, 6:] = z * pixels, -x * pixels
        rows[2, :, :3], rows[2, :, 3:6] = -y * pixels, x * pixels
        flat = rows.reshape(-1, 9)
        self._A = np.linalg.eigh(flat.T @ flat)[1][:, 0].reshape(3, 3)
        if (self.directions(index) * seen).sum() < 0:
            self._A = -self._A
        off = _off_plane(towards)
        judged_off = np.count_nonzero(off) >= FEWEST
        self.fits = self._meets(index, seen) and (not judged_off or self._meets(judged[off], towards[off]))
        middle = (shape[0] // 2) * shape[1] + shape[1] // 2
        one, other = self.directions(np.array([middle, middle - 1]))
        self.pixel = float(np.linalg.norm(one - other))

    def _meets(self, index: IntArray, seen: FloatArray) -> bool:
        """Whether nine of ten pixels (M,) look along the lines (M, 3) to what they saw."""
        along = (self.directions(index) * seen).sum(axis=1)
        return bool(np.mean(along > np.cos(MOST_ERROR) * np.linalg.norm(seen, axis=1)) >= 0.9)

    @property
    def axes(self) -> tuple[FloatArray, FloatArray]:
        """Where the image's lower edge and its middle are, (3,) each, of length one and across each other."""
        column = self.shape[1] // 2
        top, bottom = self.directions(np.array([column, (self.shape[0] - 1) * self.shape[1] + column]))
        forward = (top + bottom) / np.linalg.norm(top + bottom)
        return (bottom - top) / np.linalg.norm(bottom - top), forward

    def rays(self) -> FloatArray:
        """(3, 3): a pixel (column, row, 1) looks along rays @ pixel, of length one in the middle of the image."""
        middle = (self.shape[0] - 1) / 2, (self.shape[1] - 1) / 2
        to_scaled = np.array(
            [
                [self._scale, 0, -middle[1] * self._scale],
                [0, self._scale, -middle[0] * self._scale],
                [0, 0, 1],
            ]
        )
        return np.asarray(self._A @ to_scaled / np.linalg.norm(self._A[:, 2]))

    def directions(self, index: IntArray) -> FloatArray:
        """(M, 3) of length one: along these pixels' lines, away from the viewpoint."""
        lines = self._pixels(index) @ self._A.T
        return np.asarray(lines / np.maximum(np.linalg.norm(lines, axis=1, keepdims=True), 1e-12))

    def _pixels(self, index: IntArray) -> FloatArray:
        row, column = np.divmod(index, self.shape[1])
        middle = (self.shape[0] - 1) / 2, (self.shape[1] - 1) / 2
        return np.stack(
            [(column - middle[1]) * self._scale, (row - middle[0]) * self._scale, np.ones(len(index))], axis=1
        )

    def unseen(
        self, holes: NDArray[np.bool_], index: IntArray, points: NDArray, plane: FloatArray | None
    ) -> FloatArray:
        """(K, 3) the far ends of the lines on which nothing was measured in an object and beside it.

        holes (H · W,): pixels without depth. index, points (M, 3): the object's pixels and where they are. plane: the
        lines end on this table, and without one as far away as the object's farthest point.
        """
        middle = float(np.linalg.norm(points[len(points) // 2] - self.viewpoint))
        across = BESIDE / max(middle * self.pixel, 1e-6)
        reach = int(np.clip(np.ceil(across), 1, max(self.shape)))
        at = holes_at(holes.reshape(self.shape), index, reach)
        if not len(at):
            return np.empty((0, 3))
        along = self.directions(at)
        far = np.zeros(len(at))
        if plane is not None:
            sinking = -(along @ plane[:3])
            height = float(self.viewpoint @ plane[:3] + plane[3])
            meets = (sinking > 1e-6) & (height > 0)
            far[meets] = height / sinking[meets]
        if not far.all():
            far[far == 0] = np.linalg.norm(points - self.viewpoint, axis=1).max()
        return np.asarray(self.viewpoint + far[:, None] * along)


def _evenly(points: NDArray, index: IntArray, most: int, viewpoint: FloatArray) -> tuple[IntArray, FloatArray]:
    """At most so many of the pixels (N,), in even steps, and where they are seen from the viewpoint, (M, 3) m."""
    index = index[np.linspace(0, len(index) - 1, min(most, len(index))).astype(np.int64)]
    seen = points.take(index, axis=0).astype(np.float64) - viewpoint
    apart = (seen * seen).sum(axis=1) > 1e-12
    return index[apart], seen[apart]


def _off_plane(seen: FloatArray) -> NDArray[np.bool_]:
    """Which of the points (M, 3), seen from 0, lie off the plane that half of them or more lie on."""
    some = np.ascontiguousarray(seen[:: max(1, len(seen) // IN_ROUNDS)].T)
    near, most = np.ones(some.shape[1], dtype=bool), (some.shape[1] - 1) // 2
    for _ in range(PLANE_ROUNDS):
        half = some[:, near]
        middle = half.mean(axis=1)
        half -= middle[:, None]
        normal = np.linalg.eigh(half @ half.T)[1][:, 0]
        away = np.abs(normal @ some - normal @ middle)
        last, near = near, away <= np.partition(away, most)[most]
        if np.array_equal(last, near):
            break
    away = np.abs(seen @ normal - normal @ middle)
    return np.asarray(away > OFF_PLANE * np.sqrt(np.einsum("ij,ij->i", seen, seen)))


def holes_at(holes: NDArray[np.bool_], index: IntArray, reach: int) -> IntArray:
    """Pixels (K,) without depth in an object (M,) or within `reach` pixels of it, that hang together with it."""
    row, column = np.divmod(index, holes.shape[1])
    top, left = max(int(row.min()) - reach, 0), max(int(column.min()) - reach, 0)
    window = holes[top : int(row.max()) + reach + 1, left : int(column.max()) + reach + 1]
    if not window.any():
        return np.empty(0, dtype=np.int64)
    own = np.zeros(window.shape, dtype=bool)
    own[row - top, column - left] = True
    unmeasured = (_spread(own, reach) | _between(own)) & window
    if not unmeasured.any():
        return np.empty(0, dtype=np.int64)
    together, count = ndimage.label(unmeasured | own, structure=np.ones((3, 3)))
    belongs = np.zeros(count + 1, dtype=bool)
    belongs[together[row - top, column - left]] = True
    rows, columns = np.nonzero(unmeasured & belongs[together])
    return np.asarray((rows + top) * holes.shape[1] + columns + left, dtype=np.int64)


def _spread(own: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """The mask (H, W) and all within so many rows and columns of it."""
    spread = own.copy()
    for target in (spread, spread.T):
        done = 0
        while done < reach:
            step = min(2 * done + 1, reach - done)
            before = target.copy()
            target[step:] |= before[:-step]
            target[:-step] |= before[step:]
            done += step
    return spread


def _between(own: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels with some of the object's on all four sides."""
    rows, columns = np.arange(own.shape[0])[:, None], np.arange(own.shape[1])
    top, left = own.argmax(axis=0), own.argmax(axis=1)[:, None]
    bottom = own.shape[0] - 1 - own[::-1].argmax(axis=0)
    right = (own.shape[1] - 1 - own[:, ::-1].argmax(axis=1))[:, None]
    inside = (rows > top) & (rows < bottom) & (columns > left) & (columns < right)
    inside &= own.any(axis=0)
    inside &= own.any(axis=1, keepdims=True)
    return np.asarray(inside)
