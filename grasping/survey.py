"""The report on an object's regions for `CurvaturePlanner`: even slabs across the long axis and their parts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasping.curvature import variation_at
from grasping.grasp import RegionReport
from grasping.primitives import all_alike, primitive_of
from grasping.profiles import Holds
from grasping.views import View, last_in_cells

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

THINNED = 200  # cells of the footprint, on the highest point in each of which σ is measured
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

    def regions_at(self, points: FloatArray) -> list[int | None]:
        """Index of the smallest region whose footprint holds each of the points (M, 3) of the cloud's frame, if any."""
        if not self.regions:
            return [None] * len(points)
        place = ((points - self.view.origin) @ self.view.axes)[:, :2]
        area = (self.high - self.low).prod(axis=1)[:, None]
        area = np.where(_inside(place, self.low, self.high), area, np.inf)
        smallest, found = area.argmin(axis=0).tolist(), np.isfinite(area.min(axis=0)).tolist()
        return [region if inside else None for region, inside in zip(smallest, found, strict=True)]

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
    x, y = np.ascontiguousarray(view.xy.T)
    bottom, top = float(y.min()), float(y.max())
    cell = math.sqrt(float(np.ptp(x)) * (top - bottom) / THINNED)
    thinned = local[last_in_cells(view.xy, max(cell, 0.002))]
    length = max(top - bottom, 1e-9)
    count = max(1, round(length / slab_height))
    slab_of = np.minimum(((top - y) * (count / length)).astype(np.int64), count - 1)
    parts, corners, sides = [], [], []
    for slab in range(count):
        members = np.flatnonzero(slab_of == slab)
        for cluster, part in _parts(members, x[members]):
            across, along = x[part], y[part]
            first, last = int(across.argmin()), int(across.argmax())
            parts.append((slab, cluster, part))
            corners.append((float(across[first]), float(along.min()), float(across[last]), float(along.max())))
            sides += [part[first], part[last]]
    low, high = np.hsplit(np.array(corners).reshape(-1, 4), 2)
    sigma = variation_at(thinned, np.concatenate([thinned, local[sides]]), NEIGHBOURS)
    lateral = sigma[len(thinned) :].reshape(-1, 2).sum(axis=1).tolist()
    owner = _inside(thinned[:, :2], low, high)
    verdicts = _verdicts(low, high, holds, greatest_width)
    in_cloud = view.origin + local @ view.axes.T
    regions = [
        RegionReport(
            points=in_cloud[part],
            primitive=primitive_of(sigma[: len(thinned)][owner[i]]),
            width=corners[i][2] - corners[i][0],
            curvature=lateral[i],
            verdict=verdicts[i],
            slab=slab,
            cluster=cluster,
        )
        for i, (slab, cluster, part) in enumerate(parts)
    ]
    return Survey(view, regions, low, high)


def _parts(members: IntArray, x: FloatArray) -> list[tuple[int | None, IntArray]]:
    """A slab and, where it falls apart along x, its parts from the left; each of three points or more."""
    if len(members) < 3:
        return []
    order = np.argsort(x)
    gaps = np.flatnonzero(np.diff(x[order]) > PART_GAP) + 1
    parts = np.split(members[order], gaps) if len(gaps) else []
    return [(None, members), *((i, part) for i, part in enumerate(parts) if len(part) >= 3)]


def _inside(xy: FloatArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """(R, M) whether each of the points (M, 2) lies in each of the rectangles (R, 2) … (R, 2)."""
    (x, y), (x0, y0), (x1, y1) = xy.T, low.T[:, :, None], high.T[:, :, None]
    return (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)


def _verdicts(low: FloatArray, high: FloatArray, holds: Holds | None, greatest_width: float) -> list[str]:
    held = np.zeros(len(low), dtype=bool)
    if holds is not None:
        held |= _inside(np.column_stack([holds.x, holds.y]), low, high).any(axis=1)
    verdicts = []
    for width, candidate in zip((high[:, 0] - low[:, 0]).tolist(), held.tolist(), strict=True):
        if candidate:
            verdicts.append("candidate")
        elif width > greatest_width:
            verdicts.append(f"too wide: {width * 1e3:.0f} mm")
        else:
            verdicts.append("no room for the fingers")
    return verdicts
