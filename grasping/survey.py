"""The report on an object's regions for `CurvaturePlanner`: even slabs across the long axis and their parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasping.curvature import variation_at
from grasping.grasp import RegionReport
from grasping.primitives import all_alike, primitive_of
from grasping.profiles import Holds
from grasping.views import View, highest_in_cells

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

THINNED = 300  # cells of the footprint, on the highest point in each of which σ is measured
NEIGHBOURS = 10
PART_GAP = 0.010  # m along the closing axis at which a slab falls apart: less than that no finger enters
SIMILAR_LENGTH = 0.008  # m, as published


@dataclass(frozen=True)
class Survey:
    """Regions of an object, and their footprints' corners (R, 2) in the view's frame."""

    view: View
    regions: list[RegionReport]
    low: FloatArray
    high: FloatArray

    def region_at(self, point: FloatArray) -> int | None:
        """Index of the smallest region whose footprint holds this point of the cloud's frame, if one does."""
        place = ((point - self.view.origin) @ self.view.axes)[:2]
        holding = np.flatnonzero(((place >= self.low) & (place <= self.high)).all(axis=1))
        if not len(holding):
            return None
        return int(holding[(self.high - self.low)[holding].prod(axis=1).argmin()])

    def one_primitive(self) -> bool:
        """Whether all regions are alike, so that the whole object is one primitive."""
        ordered = sorted(self.regions, key=lambda region: region.curvature)
        primitives = [region.primitive for region in ordered]
        return bool(ordered) and all_alike(primitives, [region.width for region in ordered], SIMILAR_LENGTH)


def survey(view: View, holds: Holds | None, slab_height: float, greatest_width: float) -> Survey:
    """Cut into slabs of about this height, evenly, so that the last one is whole, and those into their parts.

    A region is a "candidate" where the scan found a hold whose centre lies in it.
    """
    local = np.column_stack([view.xy, view.height])
    cell = float(np.sqrt(np.ptp(view.xy, axis=0).prod() / THINNED))
    thinned = local[highest_in_cells(view.xy, view.height, max(cell, 0.002))]
    tree = cKDTree(thinned)
    y = local[:, 1]
    length = max(float(np.ptp(y)), 1e-9)
    count = max(1, round(length / slab_height))
    slab_of = np.minimum(((y.max() - y) / length * count).astype(np.int64), count - 1)
    parts, low, high, sides = [], [], [], []
    for slab in range(count):
        members = np.flatnonzero(slab_of == slab)
        for cluster, part in _parts(members, local[members, 0]):
            x = local[part, 0]
            first, last = int(x.argmin()), int(x.argmax())
            parts.append((slab, cluster, part))
            low.append((x[first], y[part].min()))
            high.append((x[last], y[part].max()))
            sides += [part[first], part[last]]
    corners = np.array(low).reshape(-1, 2), np.array(high).reshape(-1, 2)
    lateral = variation_at(thinned, local[sides], NEIGHBOURS, tree).reshape(-1, 2).sum(axis=1)
    sigma = variation_at(thinned, thinned, NEIGHBOURS, tree)
    regions = []
    for (slab, cluster, part), start, stop, curvature in zip(parts, *corners, lateral, strict=True):
        within = ((thinned[:, :2] >= start) & (thinned[:, :2] <= stop)).all(axis=1)
        regions.append(
            RegionReport(
                points=view.origin + local[part] @ view.axes.T,
                primitive=primitive_of(sigma[within]),
                width=float(stop[0] - start[0]),
                curvature=float(curvature),
                verdict=_verdict(start, stop, holds, greatest_width),
                slab=slab,
                cluster=cluster,
            )
        )
    return Survey(view, regions, *corners)


def _parts(members: IntArray, x: FloatArray) -> list[tuple[int | None, IntArray]]:
    """A slab and, where it falls apart along x, its parts from the left; each of three points or more."""
    if len(members) < 3:
        return []
    order = np.argsort(x)
    gaps = np.flatnonzero(np.diff(x[order]) > PART_GAP) + 1
    parts = np.split(members[order], gaps) if len(gaps) else []
    return [(None, members), *((i, part) for i, part in enumerate(parts) if len(part) >= 3)]


def _verdict(low: FloatArray, high: FloatArray, holds: Holds | None, greatest_width: float) -> str:
    if holds is not None and len(holds):
        inside = (holds.x >= low[0]) & (holds.x <= high[0]) & (holds.y >= low[1]) & (holds.y <= high[1])
        if inside.any():
            return "candidate"
    if high[0] - low[0] > greatest_width:
        return f"too wide: {(high[0] - low[0]) * 1e3:.0f} mm"
    return "no room for the fingers"
