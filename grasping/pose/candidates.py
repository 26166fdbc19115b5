"""Poses of one model in one part of a cloud, judged from both sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.pose.alignment import align, partners
from grasping.pose.prepared_model import PreparedModel
from grasping.pose.sight_check import look
from grasping.pose.view import View

FloatArray = NDArray[np.float64]

NOISE = 0.002, 0.004  # m and 1/m: how far off the model a point may be, and how that grows with the square of its depth
SIDEWAYS = 3.0  # times as far it may be from its partner, which is one of a sample
UNMEASURED = 0.5  # weight of a surface where nothing was measured: a hole, or another thing that a cut-out has not
SUNK = 2.0  # tolerances below the table that a point of the model may be


@dataclass(frozen=True, eq=False)
class Sought:
    """The part of a cloud in which models are sought: points, normals (S, 3), the view, the table (4,) or None, and the
    tolerance, m.
    """

    points: FloatArray
    normals: FloatArray
    view: View
    table: FloatArray | None
    tolerance: float

    def some(self, most: int) -> Sought:
        """With no more than so many points."""
        few = slice(None, None, max(1, -(-len(self.points) // most)))
        return Sought(self.points[few], self.normals[few], self.view, self.table, self.tolerance)


def tolerance_at(depth: float) -> float:
    """How far off its model a point may be at that distance (m) from the camera, m."""
    return NOISE[0] + NOISE[1] * depth * depth


@dataclass(frozen=True, eq=False)
class Judged:
    """Poses T (H, 4, 4) of a model, the best first, and of each, (H,): the share of the points on it; of the
    model's surface in sight the share that was measured and the share that contradicts; of all that faces
    the camera, hidden or not, the share that was measured; the share of the model below the table; the inliers'
    residual, m; and the score by which they are compared, where near inliers count more.
    """

    prepared: PreparedModel
    T: FloatArray
    inliers: FloatArray
    seen: FloatArray
    clear: FloatArray
    shown: FloatArray
    sunk: FloatArray
    residual: FloatArray
    score: FloatArray

    def first(self, count: int) -> Judged:
        """The best of them."""
        return self.of(np.arange(min(count, len(self.T))))

    def of(self, chosen: NDArray) -> Judged:
        """Some of them."""
        names = ("T", "inliers", "seen", "clear", "shown", "sunk", "residual", "score")
        return Judged(self.prepared, *(getattr(self, name)[chosen] for name in names))


def judge(prepared: PreparedModel, sought: Sought, T: FloatArray) -> Judged:
    """What speaks for each of the poses T_scene_object (H, 4, 4), in the order of their scores."""
    model = prepared.model
    on, off = on_surface(prepared, sought, T)
    count = on.sum(axis=1)
    inliers = on.mean(axis=1)
    residual = np.sqrt((off * off * on).sum(axis=1) / np.maximum(count, 1))
    sums = look(sought.view, model.points, model.normals, prepared.spacing, model.diameter, T, sought.tolerance)
    seen, clear, hidden, unknown = sums.T
    facing = np.maximum(seen + clear + hidden + unknown, 1e-9)
    in_sight = np.maximum(seen + clear + UNMEASURED * unknown, 1e-9)
    sunk = np.zeros(len(T))
    if sought.table is not None:
        normal = np.einsum("hji,j->hi", T[:, :3, :3], sought.table[:3])
        height = normal @ model.points.T + (T[:, :3, 3] @ sought.table[:3] + sought.table[3])[:, None]
        sunk = (height < -SUNK * sought.tolerance).mean(axis=1)
    fit = (on * (1.0 - (off / sought.tolerance) ** 2)).mean(axis=1)
    score = fit * (seen / in_sight) * (1.0 - sunk)
    order = np.argsort(-score, kind="stable")
    judged = Judged(
        *(prepared, T, inliers, seen / in_sight, clear / in_sight),
        *(seen / facing, sunk, residual, score),
    )
    return judged.of(order)


def on_surface(prepared: PreparedModel, sought: Sought, T: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """Which points (H, S) lie on the model at each of the poses (H, 4, 4), and how far before its surface (H, S), m."""
    grid = prepared.grid
    partner, place = partners(grid, sought.points, sought.normals, T)
    offset = place - grid.points[partner]
    off = np.einsum("hsi,hsi->hs", offset, grid.normals[partner])
    far = np.einsum("hsi,hsi->hs", offset, offset)
    return (partner >= 0) & (np.abs(off) < sought.tolerance) & (far < (SIDEWAYS * sought.tolerance) ** 2), off


def refined(prepared: PreparedModel, sought: Sought, T: FloatArray, reach: float, steps: int) -> Judged:
    """The poses after alignment within a reach (m) that shrinks to twice the tolerance, judged."""
    last = 2.0 * sought.tolerance
    gates = np.geomspace(reach, last, steps) if reach > last else np.full(steps, last)
    T = align(prepared.grid, sought.points, sought.normals, T, gates)
    return judge(prepared, sought, T)
