"""Align two clouds of the same things: point-to-plane ICP that does not move along what the surfaces leave open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from grasping.geometry.surface_variation import covariances

FloatArray = NDArray[np.float64]

NEIGHBOURS = 30  # for a normal: on a grid of 2 mm a patch of 6 mm, on which noise of 1 mm turns it by 3°
ALIGNED = 3000  # points of the source that take part
# Least eigenvalue of a motion that the surfaces fix: on a ball noise of 2 mm makes 0.013, a mug's handle makes 0.018.
OBSERVED = 0.015
TURNS = 0.3  # share of a free motion that must be rotation for it to be used up against a turn
SAME_SIDE = 0.5  # least cosine between the normals of two points that may be one
SETTLED = 1e-6  # m: a smaller step of the surface ends the iteration
CALM = 1e-4  # m: a smaller step narrows the search


def moved(T: FloatArray, points: FloatArray) -> FloatArray:
    """(N, 3) points of frame b in frame a, by T_a_b (4, 4)."""
    return points @ T[:3, :3].T + T[:3, 3]


@dataclass(frozen=True)
class Surface:
    """points, normals: (N, 3). oriented: the normals point to where it was seen from; else their sign means nothing."""

    points: FloatArray
    normals: FloatArray
    oriented: bool

    @staticmethod
    def of(points: FloatArray, eye: FloatArray | None = None) -> Surface:
        """The surface that a cloud (N, 3) lies on. eye: (3,) from where it was seen."""
        _, near = cKDTree(points).query(points, k=min(NEIGHBOURS, len(points)))
        normals = np.linalg.eigh(covariances(points[near]))[1][:, :, 0]
        if eye is not None:
            normals = np.where(np.einsum("ij,ij->i", normals, eye - points)[:, None] < 0, -normals, normals)
        return Surface(points, normals, eye is not None)

    def moved(self, T: FloatArray) -> Surface:
        """The same surface of frame b in frame a, by T_a_b (4, 4)."""
        return Surface(moved(T, self.points), self.normals @ T[:3, :3].T, self.oriented)

    @staticmethod
    def joined(surfaces: list[Surface]) -> Surface:
        """Several surfaces of one frame as one."""
        points = np.concatenate([each.points for each in surfaces])
        normals = np.concatenate([each.normals for each in surfaces])
        return Surface(points, normals, all(each.oriented for each in surfaces))


@dataclass(frozen=True)
class Alignment:
    """How a source lies on a target.

    T_target_source: (4, 4). overlap: share of the source's points that have a partner; rmse: their distance to the
    partners' tangent planes, m. free: (F, 6) orthonormal motions that the surfaces leave open, in the target's frame
    about `centre` (3,): three numbers of the rotation times `radius`, m, and three of the shift.
    """

    T_target_source: FloatArray
    overlap: float
    rmse: float
    free: FloatArray
    centre: FloatArray
    radius: float

    def departure(self, start: FloatArray) -> tuple[float, float, float]:
        """From another T_target_source: shift of the centre, m, turn, rad, and how much of it, m, is a free motion."""
        change = self.T_target_source @ np.linalg.inv(start)
        rotation = Rotation.from_matrix(change[:3, :3]).as_rotvec()
        shift = self.centre - moved(np.linalg.inv(change), self.centre[None])[0]
        twist = np.concatenate([rotation * self.radius, shift])
        turning, undo = _least_turn(self.free, twist)
        slid = float(np.hypot(np.linalg.norm(undo), np.linalg.norm((self.free - turning @ self.free) @ twist)))
        return float(np.linalg.norm(shift)), float(np.linalg.norm(rotation)), slid

    def free_motions(self) -> list[str]:
        """The motions that the surfaces leave open, in words."""
        turning, _ = _least_turn(self.free, np.zeros(6))
        shares, basis = np.linalg.eigh(turning)
        words = []
        for share, motion in zip(shares, basis.T @ self.free, strict=True):
            axis = motion[:3] if share > 0.5 else motion[3:]
            numbers = ", ".join(f"{value:.2f}" for value in axis / np.linalg.norm(axis) + 0.0)
            words.append(f"{'a turn about' if share > 0.5 else 'a shift along'} ({numbers})")
        return words


def _least_turn(free: FloatArray, twist: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Which of the free motions (F, 6) turn, as a projection (F, F), and how much of them (F,) a twist (6,) contains
    that a twist with the same effect would not.
    """
    u, sizes, vt = np.linalg.svd(free[:, :3].T, full_matrices=False)
    turns = sizes > TURNS
    return vt[turns].T @ vt[turns], vt[turns].T @ (u[:, turns].T @ twist[:3] / sizes[turns])


def align(
    source: Surface,
    target: Surface,
    start: FloatArray,
    *,
    distance: float,
    iterations: int,
    search: float | None = None,
) -> Alignment:
    """Iterative closest points (Chen and Medioni 1992), at most `distance` (m) apart, from T_target_source = `start`.

    search: a larger distance (m) to begin with, for a start that is farther off.

    Residuals are weighted by Huber's function. The step leaves out each eigenvector of the normal equations whose
    eigenvalue says that the surfaces do not fix it (Zhang, Kaess and Singh 2016), and of the motions that then fit
    alike takes the one that turns least: a cylinder is not turned about its axis, a sphere not at all. Once settled the
    search narrows to three times the spacing of the points, so that the edges of what only one of the two has seen pull
    no longer.
    """
    few = slice(None, None, max(1, len(source.points) // ALIGNED))
    thin = Surface(source.points[few], source.normals[few], source.oriented)
    tree = cKDTree(target.points)
    T, reaches = start, [search or distance, distance, min(distance, 3.0 * _spacing(target.points, tree))]
    for _ in range(iterations):
        here = thin.moved(T)
        fit = _Fit.of(here, target, tree, reaches[0])
        if fit is None:
            break
        T = fit.step @ T
        size = float(np.abs(moved(fit.step, here.points) - here.points).max())
        if len(reaches) > 1 and size < CALM:
            reaches.pop(0)
        elif size < SETTLED:
            break
    fit = _Fit.of(thin.moved(T), target, tree, distance)
    if fit is None:
        return Alignment(T, 0.0, np.inf, np.eye(6), moved(T, thin.points).mean(axis=0), 1.0)
    return Alignment(T, fit.share, fit.rmse, fit.free, fit.centre, fit.radius)


@dataclass(frozen=True)
class _Fit:
    """One step of Gauss and Newton (4, 4) in the target's frame, and what it is taken from; see `Alignment`."""

    step: FloatArray
    share: float
    rmse: float
    free: FloatArray
    centre: FloatArray
    radius: float

    @staticmethod
    def of(here: Surface, target: Surface, tree: cKDTree, reach: float) -> _Fit | None:
        """None where too few points have a partner."""
        gap, partner = tree.query(here.points, distance_upper_bound=reach)
        paired = np.flatnonzero(np.isfinite(gap))
        alike = np.einsum("ij,ij->i", here.normals[paired], target.normals[partner[paired]])
        paired = paired[(alike if here.oriented and target.oriented else np.abs(alike)) > SAME_SIDE]
        if len(paired) < 20:
            return None
        points, normal = here.points[paired], target.normals[partner[paired]]
        residual = np.einsum("ij,ij->i", points - target.points[partner[paired]], normal)
        centre = points.mean(axis=0)
        arm = points - centre
        radius = float(np.sqrt(np.einsum("ij,ij->", arm, arm) / len(arm))) + 1e-9
        jacobian = np.concatenate([np.cross(arm, normal) / radius, normal], axis=1)
        tolerated = 1.345 * 1.4826 * float(np.median(np.abs(residual))) + 1e-9
        weight = np.minimum(1.0, tolerated / np.maximum(np.abs(residual), 1e-12))
        weight /= weight.sum()
        values, vectors = np.linalg.eigh((jacobian * weight[:, None]).T @ jacobian)
        fixed = values > OBSERVED
        twist = -(vectors[:, fixed] / values[fixed]) @ (vectors[:, fixed].T @ (jacobian.T @ (weight * residual)))
        free = vectors[:, ~fixed].T
        twist -= free.T @ _least_turn(free, twist)[1]
        step = np.eye(4)
        step[:3, :3] = Rotation.from_rotvec(twist[:3] / radius).as_matrix()
        step[:3, 3] = centre + twist[3:] - step[:3, :3] @ centre
        rmse = float(np.sqrt((residual * residual).mean()))
        return _Fit(step, len(paired) / len(here.points), rmse, free, centre, radius)


def _spacing(points: FloatArray, tree: cKDTree) -> float:
    """Median distance from a point to its nearest neighbour, m."""
    few = points[:: max(1, len(points) // 500)]
    return float(np.median(tree.query(few, k=2)[0][:, 1]))
