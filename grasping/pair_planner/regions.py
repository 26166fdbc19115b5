"""Grasps all over a long object: each region of it is planned as if it were one, with the rest of it in the way.

A planner for one hand looks near the centre of mass, where one hand should be. Cut into overlapping slabs across the
long axis, an object offers its ends as well.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.grasp import Grasp, GraspPlanner
from grasping.pair_planner.centre_of_mass import Footprint

FloatArray = NDArray[np.float64]

SLAB = 0.09  # m along the object, three fingers wide; slabs overlap by half
NEAR = 0.10  # m beyond a slab, in which the rest of the object is in the way
FEWEST = 30  # points of a slab
ALIKE = 0.015  # m between grasps that are one
PARALLEL = 0.94  # cosine between their closing directions


def grasps_by_region(
    points: FloatArray,
    outline: Footprint,
    planner: GraspPlanner,
    *,
    table: FloatArray,
    obstacles: FloatArray,
    viewpoint: FloatArray | None,
) -> tuple[list[Grasp], list[str]]:
    """Grasps on a cloud (N, 3), the best first and no two alike, and why the regions without one have none.

    table: (4,), its normal up. obstacles: (K, 3) of other things. viewpoint: (3,) or None. Scores are the planner's,
    each within its own region.
    """
    along = points @ outline.axes[:, 0]
    length = float(outline.high[0] - outline.low[0])
    count = max(1, int(np.ceil(2 * length / SLAB)) - 1)
    centres = outline.low[0] + np.linspace(SLAB / 2, max(length - SLAB / 2, SLAB / 2), count)
    found: list[Grasp] = []
    reasons: list[str] = []
    for centre in centres:
        off = np.abs(along - centre)
        region, rest = points[off <= SLAB / 2], points[(off > SLAB / 2) & (off <= SLAB / 2 + NEAR)]
        if len(region) < FEWEST:
            reasons.append(f"only {len(region)} points")
            continue
        others = np.concatenate([rest, obstacles])
        plan = planner.plan(region, up=table[:3], table=table, obstacles=others, viewpoint=viewpoint)
        found += plan.candidates
        if plan.reason is not None:
            reasons.append(plan.reason)
    kept: list[Grasp] = []
    for grasp in sorted(found, key=lambda each: -each.score):
        if not any(_alike(grasp, other) for other in kept):
            kept.append(grasp)
    return kept, reasons


def _alike(one: Grasp, other: Grasp) -> bool:
    near = np.linalg.norm(one.pose[:3, 3] - other.pose[:3, 3]) < ALIKE
    return bool(near and abs(one.pose[:3, 0] @ other.pose[:3, 0]) > PARALLEL)
