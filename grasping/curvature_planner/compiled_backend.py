"""The compiled kernels behind the signatures of `numpy_backend`: the same results to the last bit, sooner.

`AVAILABLE` says whether this installation has them: without a compiler at hand, or after a change of the sources that
was not built yet, it has not, and the planner takes the references.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.approach_view import ApproachView
from grasping.curvature_planner.contact_refinement import Contacts
from grasping.curvature_planner.finger_scan import MEASURED, Candidates, Scan, bins_of_room
from grasping.curvature_planner.grasp_clusters import HEADING, PLACE, SAG, SAME_HEADING, SAME_PLACE, SLIDE, WIDTH
from grasping.curvature_planner.line_of_sight import PIXELS, Sight
from grasping.curvature_planner.ranking import (
    BLIND,
    BLUR,
    CANDIDATES,
    CENTRED,
    LEAST_AREA,
    LEAST_BREADTH,
    LEAST_CONTACT,
    LEAST_MEASURED,
    MOST_CLEARANCE,
    PROBLEMS,
    SLID,
    Ranked,
    Rules,
)
from grasping.curvature_planner.region_report import RegionMeasures
from grasping.curvature_planner.scoring import (
    ALIKE_HEADING,
    ALIKE_PLACE,
    ALIKE_TIP,
    ASSUMED,
    DEEP_ENOUGH,
    NARROWEST,
    OVERLAP,
    REFINED,
    SHALLOW,
    weights_of,
)
from grasping.curvature_planner.unseen_back import MOST_CELLS
from grasping.geometry.primitives import FLAT

FloatArray = NDArray[np.float64]

INTERFACE = 9  # as in csrc/module.c
MOST_TRIED = 64  # likewise


def _load() -> Any:
    try:
        from grasping.curvature_planner import _kernels
    except ImportError:
        return None
    return _kernels if getattr(_kernels, "INTERFACE", None) == INTERFACE else None


_KERNELS = _load()
AVAILABLE = _KERNELS is not None
_NONE, _NOTHING = np.empty(0), np.empty((3, 0))


class CompiledBackend:
    """A `backend.Backend`, where `AVAILABLE`."""

    @staticmethod
    def short_side(cloud: FloatArray, axes: FloatArray, cell: float) -> tuple[float, float]:
        """`projection.short_side`."""
        return _KERNELS.short_side(cloud, np.ascontiguousarray(axes), cell)

    @staticmethod
    def thin(cloud: FloatArray, axes: FloatArray, box: float, depth: float) -> FloatArray:
        """`projection.thin`."""
        thinned = np.empty_like(cloud)
        count = _KERNELS.thin(cloud, np.ascontiguousarray(axes), box, depth, thinned)
        return np.ascontiguousarray(thinned[:, :count])

    @staticmethod
    def place(
        cloud: FloatArray, axes: FloatArray, table_height: float | None, cell: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, tuple[float, float]]:
        """`projection.place`."""
        local = np.empty_like(cloud)
        height = math.nan if table_height is None else table_height
        *middle, x, y, farthest, volume = _KERNELS.place(cloud, np.ascontiguousarray(axes), height, cell, local)
        return local, np.array(middle), np.array([x, y]), (farthest, volume)

    @staticmethod
    def neighbours(
        others: FloatArray, axes: FloatArray, middle: FloatArray, reach: FloatArray, cell: float
    ) -> FloatArray:
        """`projection.neighbours`."""
        found = np.empty((3, len(others)))
        lengths = (*middle.tolist(), *reach.tolist(), cell)
        count = _KERNELS.neighbours(np.ascontiguousarray(others), np.ascontiguousarray(axes), *lengths, found)
        return np.ascontiguousarray(found[:, :count])

    @staticmethod
    def look(
        cloud: FloatArray, obstacles: FloatArray, unseen: FloatArray, viewpoint: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """`line_of_sight.look`."""
        lens, depth = np.empty(15), np.empty((PIXELS, PIXELS))
        share = _KERNELS.look(cloud, obstacles, unseen, *viewpoint.tolist(), lens, depth)
        return lens, depth, share

    @staticmethod
    def with_its_back(cloud: FloatArray, up: FloatArray, floor: float, cell: float, sight: Sight) -> FloatArray:
        """`unseen_back.with_its_back`."""
        if not len(sight.lenses):
            return cloud
        found = np.empty((cloud.shape[1] + 4 * (MOST_CELLS + 2) ** 2, 3))  # of which hardly anything is written
        seen = (np.ascontiguousarray(sight.viewpoints), sight.lenses, sight.depth)
        count = _KERNELS.assume_back(cloud, *up.tolist(), floor, cell, *seen, found)
        return np.concatenate([cloud, found[:count].T], axis=1) if count else cloud

    @staticmethod
    def scan(
        points: FloatArray,
        obstacles: FloatArray,
        *,
        tips: FloatArray,
        headings: FloatArray,
        pad_width: float,
        finger_room: float,
        wished_room: float,
        greatest_width: float,
        reach: float,
        centre: FloatArray,
    ) -> Scan:
        """`finger_scan.scan`."""
        finger, wished = bins_of_room(finger_room, wished_room)
        found = np.empty((9, MEASURED))
        turns = (headings, np.cos(headings), np.sin(headings))
        lengths = (pad_width, wished_room, greatest_width, reach, *centre.tolist())
        count, too_wide, narrowest = _KERNELS.scan(points, obstacles, tips, *turns, *lengths, finger, wished, found)
        heading, x, y, tip, width, overlap, angle, room, whole = found[:, :count]
        return Scan(Candidates(heading, x, y, tip, width, overlap, angle, room, whole > 0.0), int(too_wide), narrowest)

    @staticmethod
    def rank(view: ApproachView, candidates: Candidates, rules: Rules) -> Ranked:
        """`ranking.rank`."""
        coarse = np.array([getattr(candidates, name) for name in Candidates.__dataclass_fields__], dtype=np.float64)
        found, problems = np.empty((22, MOST_TRIED)), np.empty(MOST_TRIED, np.int64)
        seen = (view.sight.lenses, view.sight.depth, _NOTHING if view.measured is None else view.measured)
        count, refused = _KERNELS.rank(
            *(view.points, view.obstacles, *seen, np.ascontiguousarray(view.axes), *view.origin.tolist()),
            *(coarse, len(candidates), *view.centre.tolist(), _numbers(rules), found, problems),
        )
        heading, x, y, width, angle, contact, overlap, gap, area, empty, score, tip, whole, *rest = found[:, :count]
        contacts = Contacts(heading, x, y, tip, width, angle, contact, overlap, area, gap, empty > 0.0)
        named = dict(zip(("bite", "angle", "overlap", "centre", "room", "narrow", "seen"), rest[:-2], strict=True))
        terms = {"contact": contact, **named, "whole": whole, "opening": rest[-2], "assumed": rest[-1]} if count else {}
        return Ranked(contacts, terms, score, [PROBLEMS[index] for index in problems[:refused].tolist()])

    @staticmethod
    def measure_regions(view: ApproachView, candidates: Candidates | None, slab_height: float) -> RegionMeasures:
        """`region_report.measure_regions`."""
        count = view.points.shape[1]
        order, table, measures = np.empty(count, np.int64), np.empty((count, 7), np.int64), np.empty((count, 5))
        x, y = (_NONE, _NONE) if candidates is None else (candidates.x, candidates.y)
        found = _KERNELS.survey(view.points, x, y, slab_height, FLAT, order, table, measures)
        measures = measures[:found]
        return RegionMeasures(order, table[:found], measures[:, :2], measures[:, 2:4], measures[:, 4])


@lru_cache(16)  # rules follow the object where it is low, or long and heavy
def _numbers(rules: Rules) -> FloatArray:
    """What the C struct `Rules` is filled with, in its order."""
    shares, depths = zip(*OVERLAP, strict=True)
    weights = weights_of(rules.weight_of_centre)
    coarse = weights_of(rules.coarse_weight_of_centre)
    sums = [sum(coarse[name] for name in list(coarse)[2:]), sum(weights.values())]
    return np.array(
        [
            *(rules.pad_width, rules.stroke, rules.finger_thickness),
            *(rules.finger_room, rules.wished_room, rules.greatest_width, rules.reach),
            *(rules.steepest, rules.parallel, rules.steepest + BLUR),
            *(rules.least_overlap, rules.least_points, LEAST_CONTACT, LEAST_AREA, NARROWEST),
            *(BLIND, LEAST_MEASURED, LEAST_BREADTH, rules.least_reach, ASSUMED),
            *(MOST_CLEARANCE, rules.far_from_centre),
            *(REFINED, ALIKE_PLACE, ALIKE_HEADING, ALIKE_TIP),
            *(PLACE, HEADING, WIDTH, SAME_PLACE, SAME_HEADING, SAG, SLIDE),
            *(SLID, CENTRED, CANDIDATES),
            *(SHALLOW, DEEP_ENOUGH - SHALLOW),
            *depths,
            *shares,
            *sums,
            coarse["centre"],
            *weights.values(),
        ],
        dtype=np.float64,
    )
