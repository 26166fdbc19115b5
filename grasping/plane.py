"""Find the table: RANSAC on a thinned cloud, refined on all inliers, refused where it cannot be a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

HYPOTHESES, TESTED = 128, 1000  # planes drawn, and points that each is tested on
FITTED = 6000  # points of the refinement: the plane's offset is then known to a fiftieth of the noise
MOST_TILT = np.radians(20)  # of the table against a known `up`
LEAST_SHARE = 0.15  # of the points in range that a table holds
LEAST_EXTENT = 0.20  # m, in both directions: less is the face of a box


@dataclass(frozen=True)
class Plane:
    """n·p + d = 0. band: distance (m) within which a point belongs to the plane; residual: robust σ of those, m."""

    equation: FloatArray  # (4,), n of length one
    band: float
    residual: float


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
    sample = points if len(points) <= FITTED else points[rng.integers(0, len(points), size=FITTED)]
    equation = _ransac(sample, up, rng, coarse)
    if equation is None:
        return "no plane is level enough to be a table"
    plane = _refine(sample, equation, coarse, band)
    plane = _upwards(plane, sample, up)
    higher = _higher_level(sample, plane, coarse, band)
    if higher is not None:
        plane = higher
    distance = sample @ plane.equation[:3] + plane.equation[3]
    inliers = sample[np.abs(distance) <= plane.band]
    if len(inliers) < LEAST_SHARE * len(sample):
        return f"the largest plane holds only {100 * len(inliers) / len(sample):.0f} % of the points"
    if up is not None and plane.equation[:3] @ up < np.cos(MOST_TILT):
        tilt = np.degrees(np.arccos(np.clip(plane.equation[:3] @ up, -1, 1)))
        return f"the largest plane is tilted by {tilt:.0f}° against up"
    # The spread in the plane's directions; 4 σ of a uniform strip is 1.15 times its width.
    spread = 4.0 * np.sqrt(np.linalg.eigvalsh(np.cov(inliers.T))[1])
    if spread < LEAST_EXTENT:
        return f"the largest plane is only {spread * 100:.0f} cm wide"
    return plane


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
    if not usable.any():
        return None
    normals = normals[usable] / lengths[usable, None]
    offsets = -(normals * corners[usable, 0]).sum(axis=1)
    tested = points if len(points) <= TESTED else points[rng.integers(0, len(points), size=TESTED)]
    inside = np.abs(tested @ normals.T + offsets) < coarse
    best = int(inside.sum(axis=0).argmax())
    return np.append(normals[best], offsets[best])


def _refine(points: FloatArray, equation: FloatArray, coarse: float, band: tuple[float, float]) -> Plane:
    """Least squares on the inliers, whose band shrinks to three times their residual."""
    width, residual = coarse, coarse
    for _ in range(5):
        inliers = points[np.abs(points @ equation[:3] + equation[3]) <= width]
        if len(inliers) < 10:
            break
        mean = inliers.mean(axis=0)
        centred = inliers - mean
        _, vectors = np.linalg.eigh(centred.T @ centred)
        normal = vectors[:, 0] * np.sign(vectors[:, 0] @ equation[:3] or 1.0)
        equation = np.append(normal, -normal @ mean)
        residual = 1.4826 * float(np.median(np.abs(centred @ normal)))
        width = float(np.clip(3.0 * residual, *band))
    return Plane(equation, width, residual)


def _upwards(plane: Plane, points: FloatArray, up: FloatArray | None) -> Plane:
    distance = points @ plane.equation[:3] + plane.equation[3]
    if up is not None:
        side = float(plane.equation[:3] @ up)
    elif abs(plane.equation[3]) > 0.1:
        side = float(plane.equation[3])
    else:
        side = float((distance > plane.band).sum()) - float((distance < -plane.band).sum())
    return plane if side >= 0 else Plane(-plane.equation, plane.band, plane.residual)


def _higher_level(points: FloatArray, plane: Plane, coarse: float, band: tuple[float, float]) -> Plane | None:
    """A level above the plane that is large enough to be the table itself: then the plane was the floor."""
    distance = points @ plane.equation[:3] + plane.equation[3]
    above = distance[distance > max(0.2, 3 * coarse)]
    if len(above) < LEAST_SHARE * len(points):
        return None
    counts, edges = np.histogram(above, bins=np.arange(0.0, float(above.max()) + 2 * coarse, coarse))
    pairs = counts[:-1] + counts[1:] if len(counts) > 1 else counts
    best = int(pairs.argmax())
    if pairs[best] < LEAST_SHARE * len(points):
        return None
    equation = plane.equation - np.array([0.0, 0.0, 0.0, edges[best + 1]])
    return _refine(points, equation, coarse, band)
