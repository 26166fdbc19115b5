"""The report on an object's regions for `CurvaturePlanner`: even slabs across the long axis and their parts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.approach_view import ApproachView
from grasping.curvature_planner.finger_scan import Candidates
from grasping.curvature_planner.projection import last_in_cells
from grasping.geometry.primitives import FLAT, all_alike, primitive_by_share
from grasping.geometry.surface_variation import variation_among
from grasping.grasp import RegionReport

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

THINNED = 150  # cells of the footprint, on the highest point in each of which σ is measured
NEIGHBOURS = 10
LEAST_CELL = 0.002  # m
PART_GAP = 0.010  # m along the closing axis at which a slab falls apart: less than that no finger enters
MOST_SLABS = 10**6  # a bound for grippers that do not exist
SIMILAR_LENGTH = 0.008  # m, as published


@dataclass(frozen=True)
class ObjectReport:
    """Regions of an object, and their footprints' corners (R, 2) in the view's frame."""

    view: ApproachView
    regions: list[RegionReport]
    low: FloatArray
    high: FloatArray

    def regions_at(self, points: FloatArray) -> list[int | None]:
        """Index of the smallest region whose footprint holds each of the points (M, 3) of the cloud's frame, if any."""
        corners = np.column_stack([self.low, self.high]).tolist()
        area = [(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in corners]
        footprints = [(i, *corners[i]) for i in sorted(range(len(area)), key=area.__getitem__)]
        return [
            next((i for i, x0, y0, x1, y1 in footprints if x0 <= x <= x1 and y0 <= y <= y1), None)
            for x, y, _ in ((points - self.view.origin) @ self.view.axes).tolist()
        ]

    def one_primitive(self) -> bool:
        """Whether all regions are alike, so that the whole object is one primitive."""
        ordered = sorted(self.regions, key=lambda region: region.curvature)
        primitives = [region.primitive for region in ordered]
        return bool(ordered) and all_alike(primitives, [region.width for region in ordered], SIMILAR_LENGTH)


@dataclass(frozen=True)
class RegionMeasures:
    """R slabs and parts of slabs of a view's N points.

    order: (N,) the view's points, by slab and then along x. table: (R, 7) int64, a row a part: slab, its index among
    the slab's parts or −1 for the whole slab, first point in that order, one after the last, flat ones of the points
    that σ was measured on, number of those, whether a candidate's centre lies in it. low, high: (R, 2) corners of the
    footprint. curvature: (R,) sum of the two lateral σ.
    """

    order: IntArray
    table: IntArray
    low: FloatArray
    high: FloatArray
    curvature: FloatArray


def report_regions(view: ApproachView, measures: RegionMeasures, greatest_width: float) -> ObjectReport:
    """The report on each part. It is a "candidate" where the scan found one whose centre lies in it."""
    in_cloud = view.origin + view.points.take(measures.order, axis=1).T @ view.axes.T
    widths = (measures.high[:, 0] - measures.low[:, 0]).tolist()
    regions = []
    for row, width, curvature in zip(measures.table.tolist(), widths, measures.curvature.tolist(), strict=True):
        slab, cluster, start, stop, flat, seen, held = row
        if held:
            verdict = "candidate"
        elif width > greatest_width:
            verdict = f"too wide: {width * 1e3:.0f} mm"
        else:
            verdict = "no room for the fingers"
        primitive, part = primitive_by_share(flat, seen), None if cluster < 0 else cluster
        regions.append(RegionReport(in_cloud[start:stop], primitive, width, curvature, verdict, slab, part))
    return ObjectReport(view, regions, measures.low, measures.high)


def measure_regions(view: ApproachView, candidates: Candidates | None, slab_height: float) -> RegionMeasures:
    """Cut into slabs of about this height, evenly, so that the last one is whole, and those into their parts.

    This is the reference of `compiled_backend.measure_regions`, which repeats its arithmetic.
    """
    local = np.ascontiguousarray(view.points.T)
    x, y, _ = view.points
    bottom, top = float(y.min()), float(y.max())
    cell = math.sqrt(float(np.ptp(x)) * (top - bottom) / THINNED)
    thinned = local[last_in_cells(x, y, max(cell, LEAST_CELL))]
    length = max(top - bottom, 1e-9)
    count = min(max(1, round(length / slab_height)), MOST_SLABS)
    slab_of = np.minimum(((top - y) * (count / length)).astype(np.int64), count - 1)
    order = np.lexsort((x, slab_of))
    local, x, y = local[order], x[order], y[order]
    pieces = _pieces(x, slab_of[order])
    starts, stops = pieces[:, 2], pieces[:, 3]
    low = np.column_stack([x[starts], [y[start:stop].min() for start, stop in pieces[:, 2:]]]).reshape(-1, 2)
    high = np.column_stack([x[stops - 1], [y[start:stop].max() for start, stop in pieces[:, 2:]]]).reshape(-1, 2)
    sides = np.column_stack([starts, stops - 1]).reshape(-1)
    sigma = variation_among(thinned, np.concatenate([thinned, local[sides]]), NEIGHBOURS)
    owner = _inside(thinned[:, :2], low, high)
    flat = (owner & (sigma[: len(thinned)] <= FLAT)).sum(axis=1)
    held = np.zeros(len(pieces), dtype=bool)
    if candidates is not None:
        held |= _inside(np.column_stack([candidates.x, candidates.y]), low, high).any(axis=1)
    table = np.column_stack([pieces, flat, owner.sum(axis=1), held])
    return RegionMeasures(order, table, low, high, sigma[len(thinned) :].reshape(-1, 2).sum(axis=1))


def _pieces(x: FloatArray, slab: IntArray) -> IntArray:
    """Slabs and, of those that fall apart along x, the parts from the left; each of three points or more.

    x, slab (N,): sorted by slab and then by x. Rows are (slab, index of the part or −1, first point, one after last).
    """
    breaks = np.flatnonzero((np.diff(x) > PART_GAP) | (np.diff(slab) > 0)) + 1
    found: list[tuple[int, int, int, int]] = []
    for number, group in groupby(pairwise([0, *breaks.tolist(), len(x)]), key=lambda piece: int(slab[piece[0]])):
        within = list(group)
        regions = [(-1, (within[0][0], within[-1][1])), *(enumerate(within) if len(within) > 1 else ())]
        found += [(number, index, start, stop) for index, (start, stop) in regions if stop - start >= 3]
    return np.array(found, dtype=np.int64).reshape(-1, 4)


def _inside(xy: FloatArray, low: FloatArray, high: FloatArray) -> NDArray[np.bool_]:
    """(R, M) whether each of the points (M, 2) lies in each of the rectangles (R, 2) … (R, 2)."""
    (x, y), (x0, y0), (x1, y1) = xy.T, low.T[:, :, None], high.T[:, :, None]
    return (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
