"""The planes of a cloud, the largest first: RANSAC on what the last one left, refined on all inliers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation import kernels

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

HYPOTHESES, TESTED = 128, 640  # planes drawn, and points that each is tested on
NEARBY = (
    16  # draws, of which half of the hypotheses take the nearest two: a small plane is drawn as often as a large one
)
LEVEL = 32  # more of them, level with a known `up` and through one point
MOST_TILT = np.radians(20)  # of the table against a known `up`
MOST = 5  # planes that are looked for
LEAST_SHARE = 0.05  # of the points that a plane holds


@dataclass(frozen=True)
class Plane:
    """n·p + d = 0. band: distance (m) within which a point belongs to the plane; residual: robust σ of those, m."""

    equation: FloatArray  # (4,), n of length one
    band: float
    residual: float

    def distances(self, points: NDArray) -> FloatArray:
        """Signed distance (N,) of points (N, 3), m, positive above."""
        return points @ self.equation[:3] + self.equation[3]

    def turned(self) -> Plane:
        """The same with the other side up."""
        return Plane(-self.equation, self.band, self.residual)


def find_planes(
    points: FloatArray, up: FloatArray | None, rng: np.random.Generator, coarse: float, band: tuple[float, float]
) -> list[Plane]:
    """The planes of a cloud (N, 3), the largest first; with `up` only those that are level. For coarse, band see
    `find_table`.
    """
    found: list[Plane] = []
    left = points
    while len(found) < MOST and len(left) >= max(LEAST_SHARE * len(points), 50 if not found else 0):
        equation = _ransac(left, up, rng, coarse)
        if equation is None:
            break
        plane = refine(left, equation, coarse, band)
        distance = np.abs(plane.distances(left))
        if np.count_nonzero(distance <= plane.band) < LEAST_SHARE * len(points) and found:
            break
        found.append(plane)
        left = left[distance > max(coarse, plane.band)]
    return found


def _ransac(points: FloatArray, up: FloatArray | None, rng: np.random.Generator, coarse: float) -> FloatArray | None:
    corners = rng.integers(0, len(points), size=(HYPOTHESES, 3))
    drawn = rng.integers(0, len(points), size=(HYPOTHESES // 2, NEARBY))
    tested = rng.integers(0, len(points), size=TESTED) if len(points) > TESTED else np.arange(len(points))
    if kernels.compiled is None:
        return draw_plane_reference(points, corners, drawn, tested, up, coarse)
    plane = np.empty(4)
    found = kernels.compiled.draw_plane(points, corners, drawn, tested, up, LEVEL, np.cos(MOST_TILT), coarse, plane)
    return plane if found else None


def draw_plane_reference(
    points: FloatArray, corners: IntArray, drawn: IntArray, tested: IntArray, up: FloatArray | None, coarse: float
) -> FloatArray | None:
    """(4,) of the planes through points (N, 3) the first that most of the tested ones (T,) are near; None for none.

    corners (H, 3): the points of a plane each. drawn (K, NEARBY): of those, the two that are nearest to the first
    corner take the place of the other two.
    """
    half = len(drawn)
    apart = [points[drawn, k] - points[corners[:half, :1], k] for k in range(3)]
    nearest = np.argsort(apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2], axis=1, kind="stable")
    corners = corners.copy()
    corners[:half, 1:] = np.take_along_axis(drawn, nearest[:, :2], axis=1)
    x, y, z = (points[corners, k] for k in range(3))
    one, other = ([at[:, k] - at[:, 0] for at in (x, y, z)] for k in (1, 2))
    normal = [one[i] * other[j] - one[j] * other[i] for i, j in ((1, 2), (2, 0), (0, 1))]
    length = np.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
    usable = length > 1e-6  # three points on a line span no plane
    if up is not None:
        rising = np.abs(normal[0] * up[0] + normal[1] * up[1] + normal[2] * up[2])
        usable &= rising > np.cos(MOST_TILT) * length
    normals = np.stack([part[usable] / length[usable] for part in normal], axis=1)
    through = points[corners[usable, 0]]
    if up is not None:  # three points of a table that is a sixth of the view are drawn once in 200 times, one often
        through = np.vstack([through, points[corners[:LEVEL, 1]]])
        normals = np.vstack([normals, np.tile(up, (len(corners[:LEVEL]), 1))])
    if not len(normals):
        return None
    a, b, c = normals.T
    offsets = -(a * through[:, 0] + b * through[:, 1] + c * through[:, 2])
    u, v, w = points[tested].T
    inside = np.abs(a[:, None] * u + b[:, None] * v + c[:, None] * w + offsets[:, None]) < coarse
    best = int(np.count_nonzero(inside, axis=1).argmax())
    return np.append(normals[best], offsets[best])


def refine(points: FloatArray, equation: FloatArray, coarse: float, band: tuple[float, float]) -> Plane:
    """Least squares on the inliers, whose band shrinks to three times their residual."""
    if kernels.compiled is None:
        return refine_reference(points, equation, coarse, band)
    refined = np.array(equation)
    width, residual = kernels.compiled.refine_plane(points, coarse, *band, refined)
    return Plane(refined, width, residual)


def refine_reference(points: FloatArray, equation: FloatArray, coarse: float, band: tuple[float, float]) -> Plane:
    """`refine` in NumPy; sums are added up point by point, as C does."""
    width, residual = coarse, coarse
    x, y, z = points.T
    for _ in range(8):
        a, b, c, d = equation
        at = np.flatnonzero(np.abs(x * a + y * b + z * c + d) <= width)
        if len(at) < 10:
            break
        inliers = [part[at] for part in (x, y, z)]
        mean = [np.cumsum(part)[-1] / len(at) for part in inliers]
        centred = [part - middle for part, middle in zip(inliers, mean, strict=True)]
        pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
        n = _least_axis(*(float(np.cumsum(centred[i] * centred[j])[-1]) for i, j in pairs))
        if n[0] * a + n[1] * b + n[2] * c < 0:
            n = [-part for part in n]
        equation = np.array([*n, -(n[0] * mean[0] + n[1] * mean[1] + n[2] * mean[2])])
        off = np.abs(centred[0] * n[0] + centred[1] * n[1] + centred[2] * n[2])
        residual = 1.4826 * float(np.median(off))
        last, width = width, float(np.clip(3.0 * residual, *band))
        if abs(last - width) < 0.002 * width:
            break
    return Plane(equation, width, residual)


def _least_axis(xx: float, xy: float, xz: float, yy: float, yz: float, zz: float) -> list[float]:
    """The axis of length one along which a symmetric matrix is least, by Jacobi's rotations."""
    a = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]
    axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    for p, q, r in ((0, 1, 2), (0, 2, 1), (1, 2, 0)) * 12:
        if a[p][q] == 0.0:
            continue
        theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q])
        t = math.copysign(1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0)), -1.0 if theta < 0 else 1.0)
        c = 1.0 / math.sqrt(t * t + 1.0)
        s, turned = t * c, t * a[p][q]
        a[p][p] -= turned
        a[q][q] += turned
        a[p][q] = a[q][p] = 0.0
        rp, rq = a[r][p], a[r][q]
        a[r][p] = a[p][r] = c * rp - s * rq
        a[r][q] = a[q][r] = s * rp + c * rq
        for row in axes:
            row[p], row[q] = c * row[p] - s * row[q], s * row[p] + c * row[q]
    least = 1 if a[1][1] < a[0][0] else 0
    least = 2 if a[2][2] < a[least][least] else least
    return [row[least] for row in axes]


def _normal_form(scatter: FloatArray, mean: FloatArray, like: FloatArray) -> FloatArray:
    """(4,) the plane of points with this scatter matrix about their mean, on the side of the one that it is like."""
    _, vectors = np.linalg.eigh(scatter)
    normal = vectors[:, 0] * np.sign(vectors[:, 0] @ like[:3] or 1.0)
    return np.append(normal, -normal @ mean)


def heights_above(points: NDArray, valid: NDArray[np.bool_], plane: FloatArray) -> NDArray:
    """(N,) of points (N, 3) above a plane (4,), m, in their own type; NaN where one is not valid."""
    if kernels.compiled is None or points.dtype.char not in "fd":
        return heights_above_reference(points, valid, plane)
    heights = np.empty(len(points), dtype=points.dtype)
    kernels.compiled.rise_over_plane(np.ascontiguousarray(points), valid, *plane.tolist(), heights)
    return heights


def heights_above_reference(points: NDArray, valid: NDArray[np.bool_], plane: FloatArray) -> NDArray:
    """`heights_above` in NumPy."""
    a, b, c, d = plane.astype(points.dtype)
    x, y, z = points.T
    with np.errstate(over="ignore", invalid="ignore"):
        heights = a * x + b * y + c * z + d
    heights[~valid] = np.nan
    return np.asarray(heights)


def fit_all(plane: Plane, inliers: NDArray) -> Plane:
    """The plane by least squares on all of its inliers (M, 3), whose number may be hundreds of thousands."""
    if len(inliers) < 10:
        return plane
    # The sums run in the points' own type: about the middle, float32 leaves an error of 1e-5 rad.
    columns = np.ascontiguousarray(inliers.T)
    mean = columns.mean(axis=1, keepdims=True)
    columns -= mean
    scatter = np.empty((3, 3))
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        scatter[i, j] = scatter[j, i] = np.einsum("i,i->", columns[i], columns[j])
    return Plane(_normal_form(scatter, mean[:, 0].astype(np.float64), plane.equation), plane.band, plane.residual)


def basis(normal: FloatArray) -> FloatArray:
    """(3, 2) orthonormal directions in the plane with this normal."""
    x, y, z = normal.tolist()
    least = min(range(3), key=[abs(x), abs(y), abs(z)].__getitem__)
    first = np.array([(0.0, z, -y), (-z, 0.0, x), (y, -x, 0.0)][least])  # across the axis that is least along it
    first /= np.linalg.norm(first)
    a, b, c = first.tolist()
    return np.array([[a, y * c - z * b], [b, z * a - x * c], [c, x * b - y * a]])
