"""From a frame of a scene to one cloud for each object on the table."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError, cKDTree

from grasping.clouds import FARTHEST, as_cloud, unit_vector
from grasping.errors import CloudError, ConfigError
from grasping.plane import Plane, basis, find_table

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GRIPPER_CONTACT = 0.01  # m


@dataclass(frozen=True)
class Rejected:
    """Something that is no object: what ("plane", "cluster", "points"), why, and the number of points concerned."""

    what: str
    why: str
    n_points: int


@dataclass(frozen=True)
class Scene:
    """The objects of a frame, the largest first; lists of one length.

    objects: clouds (M, 3) in the frame and dtype of the input. indices: of their points in the input, flattened.
    plane: (4,), n·p + d = 0 with n up, or None. touches_border: cut off by the image. touches_gripper: within 1 cm of
    it. rejected: what was left out and why. obstacles: clouds of those of it that a gripper could hit.
    """

    objects: list[FloatArray]
    indices: list[IntArray]
    plane: FloatArray | None
    touches_border: list[bool]
    touches_gripper: list[bool]
    rejected: list[Rejected] = field(default_factory=list)
    obstacles: list[FloatArray] = field(default_factory=list)

    def summary(self) -> str:
        """What was rejected, in a sentence."""
        parts = [f"{entry.what} of {entry.n_points} points: {entry.why}" for entry in self.rejected]
        return "; ".join(parts) if parts else "nothing was rejected"


class Segmenter:
    """Crop in depth → table → outliers → clusters.

    Two things are told apart where, seen along the table's normal, a gap of more than `gap` lies between them. Seen so,
    the parts of one object that hide each other from the camera still touch, and neighbours a gap apart do not.

    depth_range: nearest and farthest distance from the frame's origin, m.
    plane_distance: RANSAC's inlier distance, m. plane_band: least and greatest distance (m) from the refined plane
        within which a point is table; between the two it is three times the plane's measured residual, so that an object of
        12 mm survives on a table whose noise is 1 to 2 mm.
    gap: see above, m. min_points: smaller clusters are noise. max_extent: larger ones are no objects for a hand, m.
    max_height: points higher above the table are left out, m.
    seed: of RANSAC's draws; the same input gives the same scene.
    """

    def __init__(
        self,
        *,
        depth_range: tuple[float, float] = (0.1, 2.0),
        plane_distance: float = 0.01,
        plane_band: tuple[float, float] = (0.003, 0.010),
        gap: float = 0.018,
        min_points: int = 40,
        max_extent: float = 0.45,
        max_height: float = 0.45,
        seed: int = 0,
    ) -> None:
        for name, value, least, most in (
            ("depth_range[0]", depth_range[0], 0.0, depth_range[1]),
            ("depth_range[1]", depth_range[1], depth_range[0] + 1e-3, FARTHEST),
            ("plane_distance", plane_distance, 1e-4, 0.5),
            ("plane_band[0]", plane_band[0], 1e-5, plane_band[1]),
            ("plane_band[1]", plane_band[1], plane_band[0], 0.5),
            ("gap", gap, 0.004, 0.5),
            ("min_points", min_points, 3, 10**7),
            ("max_extent", max_extent, 0.01, 100.0),
            ("max_height", max_height, 0.01, 100.0),
        ):
            if not (math.isfinite(value) and least <= value <= most):
                raise ConfigError(f"{name} = {value!r} must be between {least:g} and {most:g}")
        self.depth_range = depth_range
        self.plane_distance = plane_distance
        self.plane_band = plane_band
        self.gap = gap
        self.min_points = min_points
        self.max_extent = max_extent
        self.max_height = max_height
        self.seed = seed

    def segment(self, cloud: ArrayLike, *, up: ArrayLike | None = None, gripper: ArrayLike | None = None) -> Scene:
        """Find the objects in a cloud (N, 3) or an organised frame (H, W, 3), m; NaN and (0, 0, 0) are invalid.

        up: (3,) away from the table, in the cloud's frame; without it see `find_table`. gripper: (K, 3) points of one's
        own hand, for `touches_gripper`. Raises CloudError for input that is no cloud or has no valid point in range.
        """
        points, shape = _flattened(cloud)
        up_vector = None if up is None else unit_vector(up, name="up")
        hand = None if gripper is None else as_cloud(gripper, name="gripper")
        squared = np.einsum("ij,ij->i", points, points)
        near, far = max(self.depth_range[0], 1e-6), self.depth_range[1]
        valid = np.flatnonzero((squared >= near * near) & (squared <= far * far))  # NaN compares as false
        if not len(valid):
            raise CloudError(f"cloud: none of {len(points)} points is valid and {near:g} to {far:g} m away")
        inside = points[valid].astype(np.float64)

        rejected: list[Rejected] = []
        plane = find_table(
            inside, up_vector, np.random.default_rng(self.seed), coarse=self.plane_distance, band=self.plane_band
        )
        if isinstance(plane, str):
            rejected.append(Rejected("plane", plane, len(inside)))
            normal = up_vector if up_vector is not None else np.array([0.0, 0.0, -1.0])
            chosen, table = np.arange(len(inside)), None
        else:
            normal = plane.equation[:3]
            distance = inside @ normal + plane.equation[3]
            chosen = np.flatnonzero((distance > plane.band) & (distance <= self.max_height))
            table = inside[np.abs(distance) <= plane.band]
        if shape is not None:
            chosen = chosen[~_flying(inside, valid, chosen, shape)]
        flat = inside[chosen] @ basis(normal)
        labels, count, speckles = _footprints(flat, self.gap)
        if speckles:
            rejected.append(Rejected("points", "isolated", speckles))
        found = self._judge(inside, chosen, flat, labels, count, table, normal, rejected)
        border = None if shape is None else _border(valid, shape)
        kept, obstacles = found
        indices = [valid[members] for members in kept]
        return Scene(
            objects=[points[index] for index in indices],
            indices=indices,
            plane=None if isinstance(plane, str) else plane.equation,
            touches_border=[border is not None and bool(border[index].any()) for index in indices],
            touches_gripper=[hand is not None and _touch(inside[members], hand) for members in kept],
            rejected=rejected,
            obstacles=[points[valid[members]] for members in obstacles],
        )

    def _judge(
        self,
        inside: FloatArray,
        chosen: IntArray,
        flat: FloatArray,
        labels: IntArray,
        count: int,
        table: FloatArray | None,
        normal: FloatArray,
        rejected: list[Rejected],
    ) -> tuple[list[IntArray], list[IntArray]]:
        """Split the clusters into objects, the largest first, and others that may be in the way."""
        order = np.argsort(labels, kind="stable")
        bounds = np.searchsorted(labels[order], np.arange(count + 1))
        hull = None if table is None else _hull(table @ basis(normal))
        kept, obstacles = [], []
        small, small_points = 0, 0
        for start, stop in pairwise(bounds):
            members = order[start:stop]
            if len(members) < self.min_points:
                small, small_points = small + 1, small_points + len(members)
                continue
            own = inside[chosen[members]]
            extent = float(np.ptp(own, axis=0).max())
            if extent > self.max_extent:
                rejected.append(Rejected("cluster", f"{extent:.2f} m large, more than {self.max_extent} m", len(own)))
                obstacles.append(chosen[members])
            elif hull is not None and (hull[:, :2] @ flat[members].mean(axis=0) + hull[:, 2] > 0.01).any():
                rejected.append(Rejected("cluster", "beside the table", len(own)))
                obstacles.append(chosen[members])
            else:
                kept.append(chosen[members])
        if small:
            rejected.append(Rejected("points", f"{small} clusters of fewer than {self.min_points}", small_points))
        return sorted(kept, key=lambda members: -len(members)), obstacles


def _flattened(cloud: ArrayLike) -> tuple[NDArray, tuple[int, int] | None]:
    """(N, 3) points in their floating type, and (H, W) where the cloud was organised."""
    try:
        points = np.asarray(cloud)
        if points.dtype not in (np.float32, np.float64):
            points = points.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise CloudError(f"cloud: not an array of numbers ({error})") from error
    if points.ndim not in (2, 3) or points.shape[-1] != 3:
        raise CloudError(f"cloud: shape {points.shape}, expected (N, 3) or (H, W, 3)")
    shape = (points.shape[0], points.shape[1]) if points.ndim == 3 else None
    return points.reshape(-1, 3), shape


def _flying(inside: FloatArray, valid: IntArray, chosen: IntArray, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Which of the chosen points hang between two surfaces, as stereo and time of flight put them on edges.

    Such a pixel has fewer than two of its eight neighbours within 3 % of its distance.
    """
    rows, columns = shape
    padded = np.full((rows + 2, columns + 2), -1, dtype=np.int64)
    y, x = np.divmod(valid, columns)
    padded[y + 1, x + 1] = np.arange(len(valid))
    flat = padded.reshape(-1)
    stride = columns + 2
    place = (y[chosen] + 1) * stride + x[chosen] + 1
    own = inside[chosen]
    limit = 9e-4 * np.einsum("ij,ij->i", own, own)
    close = np.zeros(len(chosen), dtype=np.int64)
    for step in (-stride - 1, -stride, -stride + 1, -1, 1, stride - 1, stride, stride + 1):
        neighbour = flat[place + step]
        difference = inside[neighbour] - own
        close += (np.einsum("ij,ij->i", difference, difference) < limit) & (neighbour >= 0)
    return close < 2


def _footprints(flat: FloatArray, gap: float) -> tuple[IntArray, int, int]:
    """Label (N,) of each point's footprint in the plane, −1 for isolated points; the number of labels and of those.

    Cells of the plane that hold points are joined where they lie within the gap of each other.
    """
    if not len(flat):
        return np.empty(0, dtype=np.int64), 0, 0
    cell = gap / 4
    low = flat.min(axis=0)
    index = ((flat - low) / cell).astype(np.int64) + 3
    shape = tuple(index.max(axis=0) + 4)
    counts = np.zeros(shape, dtype=np.int32)
    np.add.at(counts, (index[:, 0], index[:, 1]), 1)
    around = ndimage.uniform_filter(counts.astype(np.float32), 3, mode="constant") * 9.0
    dense = (counts > 0) & (around > 3.5)
    # Two cells whose nearest edges are a gap apart are 5 steps from each other: discs of radius 2 around both touch.
    disc = np.hypot(*np.mgrid[-2:3, -2:3]) <= 2.3
    labelled, count = ndimage.label(ndimage.binary_dilation(dense, disc), structure=np.ones((3, 3)))
    labels = np.where(dense, labelled, 0)[index[:, 0], index[:, 1]].astype(np.int64) - 1
    return labels, count, int((labels < 0).sum())


def _border(valid: IntArray, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(H · W,) pixels at the edge of that part of the image in which the sensor sees anything.

    Stereo sensors are blind in a band at one side; a row or column that is valid in less than a tenth is outside.
    """
    seen = np.zeros(shape, dtype=bool)
    seen.reshape(-1)[valid] = True
    border = np.ones(shape, dtype=bool)
    rows = np.flatnonzero(seen.mean(axis=1) > 0.1)
    columns = np.flatnonzero(seen.mean(axis=0) > 0.1)
    if len(rows) and len(columns):
        border[rows[0] + 2 : rows[-1] - 1, columns[0] + 2 : columns[-1] - 1] = False
    return border.reshape(-1)


def _hull(flat: FloatArray) -> FloatArray | None:
    """Edges (E, 3) of the convex hull of the table, a x + b y + c ≤ 0 inside; None where it has no area."""
    step = max(1, len(flat) // 4000)
    try:
        return np.asarray(ConvexHull(flat[::step]).equations)
    except QhullError:
        return None


def _touch(points: FloatArray, hand: FloatArray) -> bool:
    if not len(hand):
        return False
    nearest, _ = cKDTree(hand).query(points, k=1, distance_upper_bound=GRIPPER_CONTACT)
    return bool(np.isfinite(nearest).any())


__all__ = ["Plane", "Rejected", "Scene", "Segmenter"]
