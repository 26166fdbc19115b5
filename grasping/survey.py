"""The report on an object's regions for `CurvaturePlanner`: even slabs across the long axis and their parts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from grasping.curvature import variation_at
from grasping.grasp import RegionReport
from grasping.primitives import all_alike, primitive_of
from grasping.profiles import Holds
from grasping.views import View, last_in_cells

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

THINNED = 150  # cells of the footprint, on the highest point in each of which σ is measured
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
    order = np.lexsort((x, slab_of))
    local, x, y = local[order], x[order], y[order]
    parts = _parts(x, slab_of[order])
    starts, stops = np.array([part[2:] for part in parts], dtype=np.int64).reshape(-1, 2).T
    low = np.column_stack([x[starts], [y[start:stop].min() for _, _, start, stop in parts]])
    high = np.column_stack([x[stops - 1], [y[start:stop].max() for _, _, start, stop in parts]])
    sides = np.column_stack([starts, stops - 1]).reshape(-1)
    sigma = variation_at(thinned, np.concatenate([thinned, local[sides]]), NEIGHBOURS)
    lateral = sigma[len(thinned) :].reshape(-1, 2).sum(axis=1).tolist()
    widths = (high[:, 0] - low[:, 0]).tolist()
    owner = _inside(thinned[:, :2], low, high)
    verdicts = _verdicts(low, high, holds, greatest_width)
    in_cloud = view.origin + local @ view.axes.T
    regions = [
        RegionReport(
            points=in_cloud[start:stop],
            primitive=primitive_of(sigma[: len(thinned)][owner[i]]),
            width=widths[i],
            curvature=lateral[i],
            verdict=verdicts[i],
            slab=slab,
            cluster=cluster,
        )
        for i, (slab, cluster, start, stop) in enumerate(parts)
    ]
    return Survey(view, regions, low, high)


def _parts(x: FloatArray, slab: IntArray) -> list[tuple[int, int | None, int, int]]:
    """Slabs and, of those that fall apart along x, the parts from the left; each of three points or more.

    x, slab (N,): sorted by slab and then by x. Returns (slab, index of the part or None, first point, one after last).
    """
    breaks = np.flatnonzero((np.diff(x) > PART_GAP) | (np.diff(slab) > 0)) + 1
    pieces = list(pairwise([0, *breaks.tolist(), len(x)]))
    found: list[tuple[int, int | None, int, int]] = []
    for number, group in groupby(pieces, key=lambda piece: int(slab[piece[0]])):
        within = list(group)
        regions = [(None, (within[0][0], within[-1][1])), *(enumerate(within) if len(within) > 1 else ())]
        found += [(number, index, start, stop) for index, (start, stop) in regions if stop - start >= 3]
    return found


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
