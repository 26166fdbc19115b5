"""The turns that bring a shape onto itself, found from its surface: about an axis by any angle, and by certain angles.

Candidates are axes through the middle that keep the shape's moments; each is refined until what it turns lies on the
surface again as well as it can, and holds where the farthest point then lies within a tolerance. Mirror images are no
turns: a shape that has them only is not symmetric here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from grasping.pose.seen_surface import directions_around

FloatArray = NDArray[np.float64]

TOLERANCE = 0.03  # of the diameter: how far off the surface the farthest point may be after a turn
ORDERS = (12, 10, 9, 8, 7, 6, 5, 4, 3, 2)  # of turns about an axis
ROUND = 9  # turns by a ninth or less go for any angle: such a polygon hardly differs from its circle
PRIMES = (2, 3, 5, 7)  # one of which divides each order
ANGLES = tuple(2 * math.pi * k / 17 for k in range(1, 17))  # that stand for any angle: no order has them
DIRECTIONS = 800  # of candidate axes over the half sphere, some 5° apart
COARSE_POINTS, FINE_POINTS = 100, 300
COARSE = 0.04  # of the diameter, mean distance at which a candidate is refined: it is off by 4° at most
ONE_AXIS = math.radians(10)  # nearer axes are one
APART = math.radians(16)  # of candidates: refined, nearer ones come to the same
MOST_REFINED = 12  # candidates an order
GRID = 56  # cells a side of the field of distances to the surface
MOST_TURNS = 60  # of the icosahedron, the largest group that is none of any angle


@dataclass(frozen=True, eq=False)
class Symmetry:
    """turns: (K, 4, 4) proper transforms of the object frame that leave the shape as it is, the identity first.

    axis: (point (3,), unit direction (3,)), m, about which any angle does, or None. ball: the centre (3,) of a shape
    that any turn about it leaves, or None; its `axis` is None and its `turns` is the identity.
    Together: a point of a surface turns about `axis` by any angle, then by one of the `turns`.
    """

    turns: FloatArray
    axis: tuple[FloatArray, FloatArray] | None = None
    ball: FloatArray | None = None

    @property
    def is_trivial(self) -> bool:
        """Whether the shape has one pose only."""
        return len(self.turns) == 1 and self.axis is None and self.ball is None

    def transforms(self, step: float = math.radians(6)) -> FloatArray:
        """All of them, (M, 4, 4), any angle in steps of at most `step`, rad; of a ball a cover with that distance."""
        if self.ball is not None:
            axes = directions_around(max(4, math.ceil(4 * math.pi / step**2)))
            tilts = [_about(self.ball, *_least_turn(np.array([0.0, 0.0, 1.0]), axis)) for axis in axes]
            spins = self._spins((self.ball, np.array([0.0, 0.0, 1.0])), step)
            return np.concatenate([tilt @ spins for tilt in tilts])
        if self.axis is None:
            return self.turns
        spins = self._spins(self.axis, step)
        return np.concatenate([turn @ spins for turn in self.turns])

    def nearest(self, T_frame_object: FloatArray, T_frame_goal: FloatArray) -> FloatArray:
        """Of all poses that look like the first, (4, 4), the one that is turned least against the goal, exactly."""
        poses = T_frame_object @ self.turns
        if self.ball is not None:
            turned = T_frame_object[:3, :3].T @ T_frame_goal[:3, :3]
            return T_frame_object @ _around(self.ball, turned)
        if self.axis is not None:
            point, direction = self.axis
            relative = np.einsum("kij,ik->kij", np.swapaxes(poses[:, :3, :3], 1, 2), np.ones((3, len(poses))))
            relative = relative @ T_frame_goal[:3, :3]
            # trace(S(θ)ᵀ M) = a + b cos θ + c sin θ, greatest at atan2(c, b).
            c = np.einsum("kij,ij->k", relative, _cross(direction))
            b = np.trace(relative, axis1=1, axis2=2) - np.einsum("i,kij,j->k", direction, relative, direction)
            poses = np.stack(
                [pose @ _about(point, direction, math.atan2(y, x)) for pose, y, x in zip(poses, c, b, strict=True)]
            )
        likeness = np.einsum("kij,ij->k", poses[:, :3, :3], T_frame_goal[:3, :3])
        return np.asarray(poses[int(likeness.argmax())])

    @staticmethod
    def _spins(axis: tuple[FloatArray, FloatArray], step: float) -> FloatArray:
        count = max(1, math.ceil(2 * math.pi / step))
        return np.stack([_about(*axis, 2 * math.pi * k / count) for k in range(count)])


def find_symmetry(points: FloatArray, normals: FloatArray, diameter: float, tolerance: float = TOLERANCE) -> Symmetry:
    """The symmetry of a surface from dense uniform points (M, 3) with unit normals (M, 3), m.

    tolerance: share of the diameter that the farthest point may be off after a turn.
    """
    surface = _Surface(points, normals, tolerance * diameter, diameter)
    axes: list[tuple[int, FloatArray, FloatArray]] = []  # order (0: any angle), point, direction
    for prime, point, direction in surface.candidate_axes():
        for order in (0, *(order for order in ORDERS if order % prime == 0)):
            if any(abs(direction @ known) > math.cos(ONE_AXIS) for _, _, known in axes):
                break
            refined = surface.axis_of_order(point, direction, order)
            if refined is not None and all(abs(refined[1] @ known) < math.cos(ONE_AXIS) for _, _, known in axes):
                axes.append((0 if order >= ROUND else order, *refined))
    round_axes = [axis for axis in axes if axis[0] == 0]
    if len(round_axes) > 1:
        return Symmetry(np.eye(4)[None], ball=surface.middle)
    if round_axes:
        _, point, direction = round_axes[0]
        turns = [np.eye(4)]
        flips = [a for a in axes if a[0] and a[0] % 2 == 0 and abs(a[2] @ direction) < math.sin(ONE_AXIS)]
        if flips:
            # Exactly across, through the axis: else the turns about it and the flip would not be one group.
            across = flips[0][2] - (flips[0][2] @ direction) * direction
            centre = point + ((flips[0][1] - point) @ direction) * direction
            turns.append(_about(centre, across / np.linalg.norm(across), math.pi))
        return Symmetry(np.stack(turns), axis=(point, direction))
    return Symmetry(surface.group([_about(p, d, 2 * math.pi / order) for order, p, d in axes]))


class _Surface:
    """A shape that turns are tried on."""

    def __init__(self, points: FloatArray, normals: FloatArray, tolerance: float, diameter: float) -> None:
        self.points, self.normals = points[::3], normals[::3]
        self.tolerance, self.diameter = tolerance, diameter
        self.tree = cKDTree(self.points)
        self.middle = points.mean(axis=0)
        self.covariance = np.cov((points - self.middle).T)
        self.fine = points[np.linspace(0, len(points) - 1, FINE_POINTS).round().astype(int)]
        # Half a million trial points are looked up in a field of distances, not in the tree.
        self.cell = 1.2 * diameter / GRID
        self.corner = self.middle - 0.6 * diameter
        empty = np.ones((GRID, GRID, GRID), bool)
        empty[tuple(self._cells(points).T)] = False
        self.field = (distance_transform_edt(empty) * self.cell).astype(np.float32).reshape(-1)

    def candidate_axes(self) -> list[tuple[int, FloatArray, FloatArray]]:
        """Axes (prime order, point, direction) through the middle that look like one, the likeliest first."""
        grid = directions_around(2 * DIRECTIONS)[:DIRECTIONS]
        principal = np.linalg.eigh(self.covariance)[1].T
        directions = np.concatenate([principal[::-1], grid])
        coarse = self.fine[:: max(1, FINE_POINTS // COARSE_POINTS)] - self.middle
        spread = float(np.trace(self.covariance))
        found: list[tuple[float, int, FloatArray]] = []
        for prime in PRIMES:
            turns = np.stack([_rotation(d, 2 * math.pi / prime) for d in directions])
            moved = turns @ self.covariance @ np.swapaxes(turns, 1, 2) - self.covariance
            likely = np.flatnonzero(np.linalg.norm(moved, axis=(1, 2)) < 0.15 * spread)
            turned = np.einsum("kij,nj->kni", turns[likely], coarse) + self.middle
            off = self.roughly_off(turned).mean(axis=1)
            kept: list[FloatArray] = []
            for k in np.argsort(off, kind="stable"):
                direction = directions[likely[k]]
                if off[k] > COARSE * self.diameter or len(kept) >= MOST_REFINED:
                    break
                if all(abs(direction @ other) < math.cos(APART) for other in kept):
                    kept.append(direction)
                    found.append((float(off[k]), prime, direction))
        found.sort(key=lambda each: each[0])
        return [(prime, self.middle, direction) for _, prime, direction in found]

    def axis_of_order(
        self, point: FloatArray, direction: FloatArray, order: int
    ) -> tuple[FloatArray, FloatArray] | None:
        """The axis, refined, where turns by full turns / order leave the shape, 0: by any angle; else None."""
        angles = ANGLES if order == 0 else [2 * math.pi * k / order for k in range(1, order)]
        return self._refined(point, direction, angles)

    def roughly_off(self, points: FloatArray) -> FloatArray:
        """How far points (..., 3) are off the surface, to a cell, and a fifth of the diameter at most, m."""
        index = self._cells(points)
        far = self.field[(index[..., 0] * GRID + index[..., 1]) * GRID + index[..., 2]]
        return np.minimum(far, 0.2 * self.diameter, dtype=np.float64)

    def _cells(self, points: FloatArray) -> NDArray[np.int64]:
        return np.clip(((points - self.corner) / self.cell).astype(np.int64), 0, GRID - 1)

    def off(self, turn: FloatArray) -> float:
        """How far the farthest point is off the surface after a turn (4, 4), m."""
        return float(self.tree.query(self.fine @ turn[:3, :3].T + turn[:3, 3])[0].max())

    def group(self, generators: Sequence[FloatArray]) -> FloatArray:
        """All turns (K, 4, 4) that follow from these and leave the shape, the identity first."""
        found = [np.eye(4)]
        waiting = [np.eye(4)]
        while waiting and len(found) < MOST_TURNS:
            one = waiting.pop()
            for generator in generators:
                turn = generator @ one
                apart = [math.acos(np.clip((np.trace(o[:3, :3].T @ turn[:3, :3]) - 1) / 2, -1, 1)) for o in found]
                if min(apart) > 2 * ONE_AXIS and self.off(turn) <= 1.5 * self.tolerance:
                    found.append(turn)
                    waiting.append(turn)
        return np.stack(found)

    def _refined(
        self, point: FloatArray, direction: FloatArray, angles: Sequence[float]
    ) -> tuple[FloatArray, FloatArray] | None:
        """The axis, moved until turns by the angles leave the shape as well as they can; None: not well enough."""
        some, few = self.fine[::2], angles[:: max(1, len(angles) // 5)]
        turned = np.concatenate([(some - point) @ _rotation(direction, angle).T + point for angle in angles])
        if self.roughly_off(turned).mean() > COARSE * self.diameter:
            return None
        u = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
        u /= np.linalg.norm(u)
        v = np.cross(direction, u)
        for step in range(5):
            p0, d0 = point, direction

            def moved(x: NDArray, p0: FloatArray = p0, d0: FloatArray = d0) -> FloatArray:
                d = d0 + x[0] * u + x[1] * v
                d /= np.linalg.norm(d)
                p = p0 + (x[2] * u + x[3] * v) * self.diameter
                return np.concatenate([(some - p) @ _rotation(d, angle).T + p for angle in few])

            now = moved(np.zeros(4))
            nearest = self.tree.query(now)[1]
            normal = self.normals[nearest]
            residual = np.einsum("ij,ij->i", normal, now - self.points[nearest])
            if step == 2 and np.mean(np.abs(residual) > self.tolerance) > 0.1:
                return None
            h = 1e-5
            jacobian = np.stack(
                [np.einsum("ij,ij->i", normal, moved(h * unit) - now) / h for unit in np.eye(4)], axis=1
            )
            weight = 1 / (1 + (residual / (0.5 * self.tolerance)) ** 2)
            left = jacobian.T @ (weight[:, None] * jacobian)
            left += 1e-6 * np.trace(left) * np.eye(4)
            x = -np.linalg.solve(left, jacobian.T @ (weight * residual))
            x *= min(1.0, 0.1 / max(float(np.abs(x).max()), 1e-12))
            direction = d0 + x[0] * u + x[1] * v
            direction = direction / np.linalg.norm(direction)
            point = p0 + (x[2] * u + x[3] * v) * self.diameter
            if np.abs(x).max() < 1e-4:
                break
        holds = all(self.off(_about(point, direction, angle)) <= self.tolerance for angle in angles)
        return (point, direction) if holds else None


def _cross(axis: FloatArray) -> FloatArray:
    x, y, z = axis
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _rotation(axis: FloatArray, angle: float) -> FloatArray:
    """(3, 3) about a unit axis (Rodrigues)."""
    k = _cross(axis)
    return np.asarray(np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k), np.float64)


def _around(point: FloatArray, rotation: FloatArray) -> FloatArray:
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = point - rotation @ point
    return transform


def _about(point: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """(4, 4) turn about an axis through a point."""
    return _around(point, _rotation(axis, angle))


def _least_turn(one: FloatArray, other: FloatArray) -> tuple[FloatArray, float]:
    """Axis and angle of the least turn that brings a unit vector onto another."""
    axis = np.cross(one, other)
    length = float(np.linalg.norm(axis))
    if length < 1e-9:
        helper = np.cross(one, np.eye(3)[np.abs(one).argmin()])
        return helper / np.linalg.norm(helper), 0.0 if one @ other > 0 else math.pi
    return axis / length, math.atan2(length, float(one @ other))
