"""In which other poses a model looks much as it does in its own: a mug upside down, or turned with its handle hidden.

What a view shows of such a thing votes for all of them, and the right one may have few votes. So they are found once,
from the model's own surface, by the votes of its own pairs, and tried at whatever pose was found.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.pose.alignment import align, partners
from grasping.pose.hypotheses import SAME_PLACE, joined, propose
from grasping.pose.metrics import mssd
from grasping.pose.object_model import ObjectModel
from grasping.pose.point_pairs import PairTable
from grasping.pose.surface_grid import SurfaceGrid

FloatArray = NDArray[np.float64]

LEAST_ALIKE = 0.6  # of the surface that lies on itself after the motion
NEAR = 0.03  # of the diameter: how far a point may be off, then
LEAST_TURN = 0.5  # rad: what is turned by less is slid along itself, which the alignment finds or the view leaves open
VOTED = 400  # motions that are looked at
MOST = 40  # that are kept
EVERY = 5  # points of the model for one that is compared
STEPS = 6
STEP = 0.05  # of the diameter: the steps about an axis of symmetry in which a motion is told from it


def look_alikes(model: ObjectModel, grid: SurfaceGrid, table: PairTable, corners: FloatArray) -> FloatArray:
    """(A, 4, 4) turns in the object frame, the ones after which the most is alike first; none is a symmetry.

    grid, table, corners: of the model, as `PreparedModel` has them.
    """
    points, normals = model.points[::EVERY], model.normals[::EVERY]
    T, _ = propose(table, corners, table.points, table.normals, model.diameter, VOTED)
    near = NEAR * model.diameter
    T = align(grid, points, normals, T, np.geomspace(SAME_PLACE * model.diameter, near, STEPS))
    partner, place = partners(grid, points, normals, T)
    alike = ((partner >= 0) & (np.linalg.norm(place - grid.points[partner], axis=2) < near)).mean(axis=1)
    turned = np.trace(T[:, :3, :3], axis1=1, axis2=2) < 1.0 + 2.0 * np.cos(LEAST_TURN)
    order = np.argsort(-alike, kind="stable")
    order = order[(alike[order] >= LEAST_ALIKE) & turned[order]]
    if not len(order):
        return np.empty((0, 4, 4))
    T, _ = joined(T[order], np.round(1e3 * alike[order]).astype(np.int64), corners, SAME_PLACE * model.diameter, VOTED)
    own = np.eye(4)
    differs = [mssd(points, each, own, model.symmetry, step=STEP) > SAME_PLACE * model.diameter for each in T]
    return T[np.array(differs)][:MOST]
