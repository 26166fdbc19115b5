"""GeoGrasp (Zapata-Impata et al., 2019): contacts near the plane that cuts the main axis at the centroid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from grasping.errors import require_between
from grasping.geometry.primitives import primitive_of
from grasping.geometry.principal_axes import principal_axes
from grasping.geometry.sampling import thinned
from grasping.geometry.surface_variation import smallest_eigenvalue_share
from grasping.geometry.voxel_grid import cube_means, cubes
from grasping.grasp import Grasp, GraspPlan, RegionReport, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.validation import object_cloud, sight, workspace

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OUTLIER_NEIGHBOURS, OUTLIER_STD = 50, 1.0
CURVATURE_RADIUS = 0.03  # m
PLANE_BAND = 0.007  # m to either side
NARROW_SEARCH = 0.35  # of the first contacts' distance, where the search areas would meet otherwise
NO_NEARER = 0.98  # of the first contacts' distances, for candidates of the second side
SLACK_COSINE = 0.20
LEAST_RANK = 1.0  # of r1 and of r2
WEIGHTS = 1.5, 1.0
LYING = 0.55  # cosine between main axis and up below which an object lies
BEST_RANK = 10.0  # r1 is at most 4, r2 at most 4


@dataclass(frozen=True)
class _Surface:
    """Points (M, 3) with unit normals (M, 3), either way round, and σ (M,) within CURVATURE_RADIUS."""

    points: FloatArray
    normals: FloatArray
    sigma: FloatArray


Sides = tuple[_Surface, _Surface]  # the candidates around the one and the other first contact
Pair = tuple[FloatArray, dict[str, float]]  # two contacts (2, 3), m, and their terms


@dataclass(frozen=True)
class _Cut:
    """The plane through the centroid (3,), normal to axis (3,); first contacts lie farthest apart along across (3,)."""

    centroid: FloatArray
    axis: FloatArray
    across: FloatArray

    def distance(self, points: FloatArray) -> FloatArray:
        """(M, 3) → (M,) m."""
        return np.abs((points - self.centroid) @ self.axis)


class GeoGraspPlanner:
    """Rank pairs of points around the two extremes of the object's middle.

    The cloud loses its statistical outliers; its main axis and centroid are those of a grid of boxes half a tip wide.
    The points within 7 mm of the plane through the centroid, normal to that axis, have two extremes: the first
    contacts. Candidates are the means of such boxes within two tips of either. Pairs are ranked by

        1.5 r1 + r2,  r1 = 2 - d1 - d2 - 10 (cos φ - 0.20),  r2 = 2 - c1 - c2 + a1 + a2 - |a1 - a2|

    d: distances to the plane, c: σ within 30 mm, both from 0 to 1 over a side's candidates; φ between the contact line
    and the axis; a: cosines between line and normals. A pair needs r1 ≥ 1 and r2 ≥ 1 and may be no nearer to the
    centroid, to the other side's first contact and to one another than the first contacts are (the second side: 0.98
    of that). Where none is left, the first contacts are held.

    tip: width of a fingertip, m; published 0.030.
    n_points: larger clouds are thinned, since σ within a radius costs quadratic time; as many as keep it within the
        published 17.5 ms.
    n_grasps: how many of the best pairs become candidates; published 1.
    tip_clearance: the pads' tips are kept this far above a known table, m. Not in the source.

    The source's extremes are those along the camera's x, or its depth for objects that lie along x; its boxes lie along
    the camera's axes. Neither may depend on the frame here. So, with `up`: across a lying object the level direction in
    the plane, which is what those two amount to; else, the plane's direction along which its points are spread most,
    which in a one-sided view is across the line of sight. The boxes lie along the cloud's principal axes. The approach
    is not in the source: with `up` it is straight down as far as the contact line allows; without, from the bulging,
    seen side.

    Terms of a grasp: `rank`, `r1`, `r2`, and `first` = 1 for the first contacts. Score: rank / 10, 0 to 1.
    """

    def __init__(
        self,
        gripper: Gripper = ROBOTIQ_2F_140,
        *,
        tip: float = 0.030,
        n_points: int = 1000,
        n_grasps: int = 1,
        tip_clearance: float = 0.004,
    ) -> None:
        require_between("tip", tip, 0.002, 0.2)
        require_between("n_points", n_points, 50, 5000)
        require_between("n_grasps", n_grasps, 1, 1000)
        require_between("tip_clearance", tip_clearance, 0.0, 0.1)
        self.gripper = gripper
        self.tip = tip
        self.n_points = n_points
        self.n_grasps = n_grasps
        self.tip_clearance = tip_clearance

    def plan(
        self,
        points: ArrayLike,
        *,
        up: ArrayLike | None = None,
        table: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
        unseen: ArrayLike | None = None,
    ) -> GraspPlan:
        """Plan on the cloud (N, 3) of one object, m. Obstacles are checked for sense, but not avoided; what was
        not seen (viewpoint, unseen) counts as free.

        Raises CloudError for a cloud, ConfigError for a scene that is none.
        """
        cloud = object_cloud(points)
        up_vector, plane, _ = workspace(up, table, obstacles)
        sight(viewpoint, unseen)
        cloud = _without_outliers(thinned(cloud, self.n_points))
        grid = principal_axes(cloud)
        cut = _cut(cloud, _box_means(cloud, cloud, grid, 0.5 * self.tip), up_vector)
        in_band = cut.distance(cloud) <= PLANE_BAND
        if not in_band.any():
            return plan_from([], [], f"nothing lies within {PLANE_BAND * 1e3:.0f} mm of the plane through the centroid")
        x = np.where(in_band, cloud @ cut.across, np.nan)
        contacts = np.array([np.nanargmin(x), np.nanargmax(x)])
        apart = float(np.linalg.norm(np.subtract(*cloud[contacts])))
        radius = 2.0 * self.tip
        if 2.0 * radius >= apart:
            radius = NARROW_SEARCH * apart
        near = cdist(cloud[contacts], cloud) <= radius
        surface, place = _described(cloud, in_band | near.any(axis=0))
        first = _taken(surface, place[contacts])
        one, other = (_boxed(_taken(surface, place[side]), cut, grid, 0.5 * self.tip) for side in near)

        ranked = _best_pairs(first, (one, other), cut)[: self.n_grasps] or [_first_contacts(first, (one, other), cut)]
        candidates = [
            self._grasp(pair, terms, cut, cloud[in_band], up_vector, plane)
            for pair, terms in ranked
            if np.linalg.norm(pair[1] - pair[0]) <= self.gripper.stroke
        ]
        wide, most = apart * 1e3, self.gripper.stroke * 1e3
        region = RegionReport(
            points=cloud[in_band],
            primitive=primitive_of(surface.sigma[place[in_band]]),
            width=apart,
            curvature=float(first.sigma.sum()),
            verdict="candidate" if candidates else f"too wide: {wide:.0f} mm",
            slab=0,
        )
        reason = f"the contacts at the object's middle are {wide:.0f} mm apart; the gripper opens {most:.0f} mm"
        return plan_from(candidates, [region], reason)

    def _grasp(
        self,
        pair: FloatArray,
        terms: dict[str, float],
        cut: _Cut,
        band: FloatArray,
        up: FloatArray | None,
        plane: FloatArray | None,
    ) -> Grasp:
        """Hold the pair of contacts (2, 3) midway between them."""
        width = float(np.linalg.norm(pair[1] - pair[0]))
        closing = (pair[1] - pair[0]) / width if width > 1e-9 else cut.across
        middle = pair.mean(axis=0)
        # The contacts are the rims of what is seen: its middle bulges from between them towards the camera.
        sideways = np.cross(closing, cut.axis)
        wish = -up if up is not None else sideways if sideways @ (middle - band.mean(axis=0)) >= 0.0 else -sideways
        # The axis, or across it, where the contact line leaves no such direction.
        wishes = ((w - (w @ closing) * closing) for w in (wish, cut.axis, cut.across))
        approach = next(w / np.linalg.norm(w) for w in wishes if np.linalg.norm(w) > 1e-3)
        pose = np.eye(4)
        pose[:3, :3] = np.column_stack([closing, np.cross(approach, closing), approach])
        pose[:3, 3] = middle
        if plane is not None:
            tips = middle + 0.5 * self.gripper.pad_length * approach
            pose[:3, 3] += max(0.0, self.tip_clearance - float(plane[:3] @ tips + plane[3])) * plane[:3]
        score = min(max(terms["rank"] / BEST_RANK, 0.0), 1.0)
        return Grasp(pose, width, score, "region", 0, terms)


def _without_outliers(cloud: FloatArray) -> FloatArray:
    """Points (N, 3) whose mean distance to their 50 nearest is at most one standard deviation above the mean of all."""
    count = min(OUTLIER_NEIGHBOURS, len(cloud) - 1)
    distance, _ = cKDTree(cloud).query(cloud, k=count + 1)
    mean = distance[:, 1:].mean(axis=1)
    return cloud[mean <= mean.mean() + OUTLIER_STD * mean.std(ddof=1) + 1e-12]  # all alike: none is an outlier


def _cut(cloud: FloatArray, boxed: FloatArray, up: FloatArray | None) -> _Cut:
    """The grasp plane of a cloud (N, 3) whose boxes have the means (M, 3)."""
    centroid = boxed.mean(axis=0)
    axis = principal_axes(boxed)[:, 0]
    if up is not None and abs(float(axis @ up)) < LYING:
        across = np.cross(up, axis)
        return _Cut(centroid, axis, across / np.linalg.norm(across))
    offset = cloud - centroid
    band = offset[np.abs(offset @ axis) <= PLANE_BAND]
    seed = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    seed /= np.linalg.norm(seed)
    level = np.column_stack([seed, np.cross(axis, seed)])
    spread = principal_axes(band @ level)[:, 0] if len(band) else np.array([1.0, 0.0])
    return _Cut(centroid, axis, level @ spread)


def _described(cloud: FloatArray, wanted: NDArray[np.bool_]) -> tuple[_Surface, IntArray]:
    """Normals and σ of the wanted points (N,) of the cloud (N, 3), and each point's index among them (N,)."""
    queries = cloud[wanted]
    within = (cdist(queries, cloud) <= CURVATURE_RADIUS).astype(np.float64)
    centred = cloud - cloud.mean(axis=0)
    i, j = np.triu_indices(3)
    # Sums of 1, x and x xᵀ over each neighbourhood in one product of matrices.
    sums = within @ np.column_stack([np.ones(len(cloud)), centred, centred[:, i] * centred[:, j]])
    mean = sums[:, 1:4] / sums[:, :1]
    covariance = np.empty((len(queries), 3, 3))
    covariance[:, i, j] = covariance[:, j, i] = sums[:, 4:] / sums[:, :1] - mean[:, i] * mean[:, j]
    normals = np.linalg.eigh(covariance)[1][:, :, 0]
    return _Surface(queries, normals, smallest_eigenvalue_share(covariance)), np.cumsum(wanted) - 1


def _taken(surface: _Surface, index: IntArray) -> _Surface:
    return _Surface(surface.points[index], surface.normals[index], surface.sigma[index])


def _boxed(surface: _Surface, cut: _Cut, axes: FloatArray, size: float) -> _Surface:
    """Means over boxes; normals are turned away from the centroid before, as those in one view are towards a camera."""
    inward = np.einsum("ij,ij->i", surface.normals, surface.points - cut.centroid) < 0.0
    outward = surface.normals * np.where(inward, -1.0, 1.0)[:, None]
    means = _box_means(surface.points, np.column_stack([surface.points, outward, surface.sigma]), axes, size)
    length = np.linalg.norm(means[:, 3:6], axis=1, keepdims=True)
    return _Surface(means[:, :3], means[:, 3:6] / np.maximum(length, 1e-12), means[:, 6])


def _box_means(points: FloatArray, values: FloatArray, axes: FloatArray, size: float) -> FloatArray:
    """Means (B, d) of the values (N, d) over the cubes of this size, along the axes, that hold points (N, 3)."""
    place = points @ axes
    return cube_means(values, cubes(place - place.min(axis=0), size))


def _ranks(one: _Surface, other: _Surface, over: Sides, cut: _Cut) -> tuple[FloatArray, FloatArray]:
    """r1, r2 (A, B) of each point of `one` with each of `other`; d and c run from 0 to 1 over the sides' candidates."""
    d1 = _normalised(cut.distance(one.points), cut.distance(over[0].points))
    d2 = _normalised(cut.distance(other.points), cut.distance(over[1].points))
    c1, c2 = _normalised(one.sigma, over[0].sigma), _normalised(other.sigma, over[1].sigma)
    line = other.points[None] - one.points[:, None]
    line /= np.maximum(np.linalg.norm(line, axis=2, keepdims=True), 1e-12)
    a1 = np.abs(np.einsum("ijk,ik->ij", line, one.normals))
    a2 = np.abs(np.einsum("ijk,jk->ij", line, other.normals))
    r1 = 2.0 - d1[:, None] - d2 - 10.0 * (np.abs(line @ cut.axis) - SLACK_COSINE)
    return r1, 2.0 - c1[:, None] - c2 + a1 + a2 - np.abs(a1 - a2)


def _normalised(values: FloatArray, among: FloatArray) -> FloatArray:
    low, high = float(among.min()), float(among.max())
    return (values - low) / (high - low) if high > low else np.zeros_like(values)


def _best_pairs(first: _Surface, sides: Sides, cut: _Cut) -> list[Pair]:
    """Pairs of candidates that meet every condition, best first."""
    one, other = sides
    # A first contact alone in its box is as far as itself: rounding must not decide about it.
    apart = float(np.linalg.norm(first.points[1] - first.points[0])) - 1e-9
    central = np.linalg.norm(first.points - cut.centroid, axis=1) - 1e-9
    from_centre = [np.linalg.norm(side.points - cut.centroid, axis=1) for side in sides]
    nearest = float(from_centre[1].min())
    fair_one = (from_centre[0] >= central[0]) & (np.linalg.norm(one.points - first.points[1], axis=1) >= apart)
    # Distances to the centroid are compared after normalising, so 0.98 counts from the nearest candidate.
    fair_other = from_centre[1] >= nearest + NO_NEARER * (central[1] - nearest)
    fair_other &= np.linalg.norm(other.points - first.points[0], axis=1) >= NO_NEARER * apart
    r1, r2 = _ranks(one, other, sides, cut)
    kept = fair_one[:, None] & fair_other & (cdist(one.points, other.points) >= NO_NEARER * apart)
    kept &= (r1 >= LEAST_RANK) & (r2 >= LEAST_RANK)
    pairs = [
        (np.array([one.points[a], other.points[b]]), _terms(float(r1[a, b]), float(r2[a, b]), first=False))
        for a, b in zip(*np.nonzero(kept), strict=True)
    ]
    return sorted(pairs, key=lambda pair: -pair[1]["rank"])


def _first_contacts(first: _Surface, sides: Sides, cut: _Cut) -> Pair:
    """The first contacts, ranked like the others."""
    left, right = _taken(first, np.array([0])), _taken(first, np.array([1]))
    r1, r2 = _ranks(left, right, sides, cut)
    return first.points, _terms(float(r1[0, 0]), float(r2[0, 0]), first=True)


def _terms(r1: float, r2: float, *, first: bool) -> dict[str, float]:
    return {"rank": WEIGHTS[0] * r1 + WEIGHTS[1] * r2, "r1": r1, "r2": r2, "first": float(first)}
