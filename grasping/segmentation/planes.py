"""The planes of a cloud, the largest first: RANSAC on what the last one left, refined on all inliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Small enough that the matrix library keeps them on one thread: on a busy machine more of them cost far more time.
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
    corners = points[rng.integers(0, len(points), size=(HYPOTHESES, 3))]
    half = HYPOTHESES // 2
    drawn = points[rng.integers(0, len(points), size=(half, NEARBY))]
    apart = drawn - corners[:half, :1]
    nearest = np.argpartition(np.einsum("ijk,ijk->ij", apart, apart), 2, axis=1)[:, :2]
    corners[:half, 1:] = np.take_along_axis(drawn, nearest[..., None], axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    usable = lengths > 1e-6  # three points on a line span no plane
    if up is not None:
        usable &= np.abs(normals @ up) > np.cos(MOST_TILT) * lengths
    normals = normals[usable] / lengths[usable, None]
    through = corners[usable, 0]
    if up is not None:  # three points of a table that is a sixth of the view are drawn once in 200 times, one often
        through = np.vstack([through, corners[:LEVEL, 1]])
        normals = np.vstack([normals, np.tile(up, (LEVEL, 1))])
    if not len(normals):
        return None
    offsets = -(normals * through).sum(axis=1)
    tested = points if len(points) <= TESTED else points[rng.integers(0, len(points), size=TESTED)]
    inside = np.abs(normals @ tested.T + offsets[:, None]) < coarse
    best = int(np.count_nonzero(inside, axis=1).argmax())
    return np.append(normals[best], offsets[best])


def refine(points: FloatArray, equation: FloatArray, coarse: float, band: tuple[float, float]) -> Plane:
    """Least squares on the inliers, whose band shrinks to three times their residual."""
    width, residual = coarse, coarse
    for _ in range(8):
        inliers = points[np.abs(points @ equation[:3] + equation[3]) <= width]
        if len(inliers) < 10:
            break
        mean = inliers.mean(axis=0)
        centred = inliers - mean
        equation = _normal_form(centred.T @ centred, mean, equation)
        residual = 1.4826 * float(np.median(np.abs(centred @ equation[:3])))
        last, width = width, float(np.clip(3.0 * residual, *band))
        if abs(last - width) < 0.002 * width:
            break
    return Plane(equation, width, residual)


def _normal_form(scatter: FloatArray, mean: FloatArray, like: FloatArray) -> FloatArray:
    """(4,) the plane of points with this scatter matrix about their mean, on the side of the one that it is like."""
    _, vectors = np.linalg.eigh(scatter)
    normal = vectors[:, 0] * np.sign(vectors[:, 0] @ like[:3] or 1.0)
    return np.append(normal, -normal @ mean)


def fit_all(plane: Plane, inliers: NDArray) -> Plane:
    """The plane by least squares on all of its inliers (M, 3), whose number may be hundreds of thousands."""
    if len(inliers) < 10:
        return plane
    # The sums run in the points' own type: about the middle, float32 leaves an error of 1e-5 rad.
    columns = np.ascontiguousarray(inliers.T)
    mean = columns.mean(axis=1, keepdims=True)
    columns -= mean
    scatter = np.array([[np.einsum("i,i->", a, b) for a in columns] for b in columns], dtype=np.float64)
    return Plane(_normal_form(scatter, mean[:, 0].astype(np.float64), plane.equation), plane.band, plane.residual)


def basis(normal: FloatArray) -> FloatArray:
    """(3, 2) orthonormal directions in the plane with this normal."""
    seed = np.eye(3)[int(np.abs(normal).argmin())]
    first = np.cross(normal, seed)
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first)])
