"""The report on an object's regions for `CurvaturePlanner`: even slabs across the long axis and their parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.curvature import variation_at
from grasping.grasp import RegionReport
from grasping.gripper import Gripper
from grasping.primitives import all_alike, primitive_of
from grasping.profiles import Holds
from grasping.views import View

FloatArray = NDArray[np.float64]

THINNED = 512  # points on which σ is measured
NEIGHBOURS = 12
PART_GAP = 0.010  # m along the closing axis at which a slab falls apart: less than that no finger enters
SIMILAR_LENGTH = 0.008  # m, as published


def report_regions(view: View, holds: Holds | None, gripper: Gripper, greatest_width: float) -> list[RegionReport]:
    """Slabs as high as a finger is wide, evenly divided so that the last one is whole, and their parts.

    A region is a "candidate" where the scan found a hold whose centre lies in it.
    """
    step = max(1, len(view.xy) // THINNED)
    local = np.column_stack([view.xy, view.height])[::step]
    sigma = variation_at(local, local, NEIGHBOURS, cKDTree(local))
    y = local[:, 1]
    count = max(1, round(float(np.ptp(y)) / gripper.finger_width))
    slab_of = np.clip(((y.max() - y) / max(float(np.ptp(y)), 1e-9) * count).astype(np.int64), 0, count - 1)
    regions = []
    for slab in range(count):
        members = np.flatnonzero(slab_of == slab)
        if len(members) < 3:
            continue
        order = members[np.argsort(local[members, 0])]
        parts = np.split(order, np.flatnonzero(np.diff(local[order, 0]) > PART_GAP) + 1)
        chosen: list[tuple[int | None, NDArray[np.int64]]] = [(None, members)]
        if len(parts) > 1:
            chosen += [(index, part) for index, part in enumerate(parts) if len(part) >= 3]
        for cluster, part in chosen:
            x = local[part, 0]
            width = float(np.ptp(x))
            curvature = float(sigma[part[int(x.argmin())]] + sigma[part[int(x.argmax())]])
            verdict = _verdict(local[part], width, holds, greatest_width)
            points = view.origin + local[part] @ view.axes.T
            regions.append(RegionReport(points, primitive_of(sigma[part]), width, curvature, verdict, slab, cluster))
    return regions


def single_primitive(regions: list[RegionReport]) -> str | None:
    """The primitive that the whole object is, where all its regions are alike."""
    ordered = sorted(regions, key=lambda region: region.curvature)
    names = [region.primitive for region in ordered]
    return names[0] if names and all_alike(names, [r.width for r in ordered], SIMILAR_LENGTH) else None


def _verdict(local: FloatArray, width: float, holds: Holds | None, greatest_width: float) -> str:
    low, high = local[:, :2].min(axis=0), local[:, :2].max(axis=0)
    if holds is not None and len(holds):
        inside = (holds.x >= low[0]) & (holds.x <= high[0]) & (holds.y >= low[1]) & (holds.y <= high[1])
        if inside.any():
            return "candidate"
    if width > greatest_width:
        return f"too wide: {width * 1e3:.0f} mm"
    return "no room for the fingers"
