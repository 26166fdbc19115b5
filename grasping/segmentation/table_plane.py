"""Find the table: RANSAC on a thinned cloud, refined on all inliers, refused where it cannot be a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Small enough that the matrix library keeps them on one thread: on a busy machine more of them cost far more time.
HYPOTHESES, TESTED = 128, 640  # planes drawn, and points that each is tested on
LEVEL = 32  # more of them, level with a known `up` and through one point
SAMPLED = 3000  # points that suffice for finding the table; the last fit is on all of its points
MOST_TILT = np.radians(20)  # of the table against a known `up`
LEAST_SHARE = 0.15  # of the points in range that a table holds
LEAST_EXTENT = 0.20  # m, in both directions: less is the face of a box
ANOTHER_FLOOR = 0.2  # m: levels nearer than this are a table and what stands on it, the farther are a table and a floor


@dataclass(frozen=True)
class Plane:
    """n·p + d = 0. band: distance (m) within which a point belongs to the plane; residual: robust σ of those, m."""

    equation: FloatArray  # (4,), n of length one
    band: float
    residual: float

    def distances(self, points: NDArray) -> FloatArray:
        """Signed distance (N,) of points (N, 3), m, positive above."""
        return points @ self.equation[:3] + self.equation[3]


def find_table(
    points: FloatArray,
    up: FloatArray | None,
    rng: np.random.Generator,
    *,
    coarse: float,
    band: tuple[float, float],
) -> Plane | str:
    """The table in a cloud (N, 3), its normal turned up; or a sentence on why the plane that was found is none.

    coarse: RANSAC's inlier distance. band: least and greatest inlier distance after the refinement, in which it is
    three times the measured residual. Without `up` the normal is turned towards the frame's origin, where the camera
    is, or, for a plane that runs through the origin (a world frame), to the side on which more points lie.
    """
    if len(points) < 50:
        return f"only {len(points)} points in range"
    equation = _ransac(points, up, rng, coarse)
    if equation is None:
        return "no plane is level enough to be a table"
    plane = _upwards(refine(points, equation, coarse, band), points, up)
    plane = _other_level(points, plane, coarse, band) or plane
    inliers = points[np.abs(plane.distances(points)) <= plane.band]
    if len(inliers) < LEAST_SHARE * len(points):
        return f"the largest plane holds only {100 * len(inliers) / len(points):.0f} % of the points"
    if up is not None and plane.equation[:3] @ up < np.cos(MOST_TILT):
        tilt = np.degrees(np.arccos(np.clip(plane.equation[:3] @ up, -1, 1)))
        return f"the largest plane is tilted by {tilt:.0f}° against up"
    if (wide := _width(inliers)) < LEAST_EXTENT:
        return f"the largest plane is only {wide * 100:.0f} cm wide"
    return plane


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


def _ransac(points: FloatArray, up: FloatArray | None, rng: np.random.Generator, coarse: float) -> FloatArray | None:
    corners = points[rng.integers(0, len(points), size=(HYPOTHESES, 3))]
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
    for _ in range(5):
        inliers = points[np.abs(points @ equation[:3] + equation[3]) <= width]
        if len(inliers) < 10:
            break
        mean = inliers.mean(axis=0)
        centred = inliers - mean
        equation = _normal_form(centred.T @ centred, mean, equation)
        residual = 1.4826 * float(np.median(np.abs(centred @ equation[:3])))
        last, width = width, float(np.clip(3.0 * residual, *band))
        if abs(last - width) < 0.02 * width:
            break
    return Plane(equation, width, residual)


def _normal_form(scatter: FloatArray, mean: FloatArray, like: FloatArray) -> FloatArray:
    """(4,) the plane of points with this scatter matrix about their mean, on the side of the one that it is like."""
    _, vectors = np.linalg.eigh(scatter)
    normal = vectors[:, 0] * np.sign(vectors[:, 0] @ like[:3] or 1.0)
    return np.append(normal, -normal @ mean)


def _width(inliers: FloatArray) -> float:
    """How wide a patch is across, m: 4 σ of a uniform strip is 1.15 times its width."""
    return 4.0 * float(np.sqrt(max(np.linalg.eigvalsh(np.cov(inliers.T))[1], 0.0)))


def _upwards(plane: Plane, points: FloatArray, up: FloatArray | None) -> Plane:
    distance = plane.distances(points)
    if up is not None:
        side = float(plane.equation[:3] @ up)
    elif abs(plane.equation[3]) > 0.1:
        side = float(plane.equation[3])
    else:
        side = float((distance > plane.band).sum()) - float((distance < -plane.band).sum())
    return plane if side >= 0 else Plane(-plane.equation, plane.band, plane.residual)


def _other_level(points: FloatArray, plane: Plane, coarse: float, band: tuple[float, float]) -> Plane | None:
    """The parallel plane that is the table instead of this one, if there is one.

    A level far above that is large enough: then the plane was the floor. Or one a little below: then the plane was the
    lid of a box that stands on the table and fills more of the view than it.
    """
    distance = plane.distances(points)
    far = max(ANOTHER_FLOOR, 3 * coarse)
    for chosen in (distance[distance > far], distance[(distance < -3 * coarse) & (distance > -far)]):
        if len(chosen) < LEAST_SHARE * len(points):
            continue
        edges = np.arange(float(chosen.min()), float(chosen.max()) + 2 * coarse, coarse)
        counts, _ = np.histogram(chosen, bins=edges)
        pairs = counts[:-1] + counts[1:] if len(counts) > 1 else counts
        best = int(pairs.argmax())
        if pairs[best] < LEAST_SHARE * len(points):
            continue
        level = refine(points, plane.equation - np.array([0.0, 0.0, 0.0, edges[best + 1]]), coarse, band)
        members = points[np.abs(level.distances(points)) <= level.band]
        if len(members) >= LEAST_SHARE * len(points) and _width(members) >= LEAST_EXTENT:
            return level
    return None
