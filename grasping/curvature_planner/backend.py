"""The planner's hot path, behind one signature: in NumPy (`numpy_backend`) and compiled (`compiled_backend`).

The two do the same arithmetic in the same order, so that their results are equal to the last bit. Whoever changes one
changes the other; tests/grasping/curvature_planner/test_compiled_backend.py compares them.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from grasping.curvature_planner.approach_view import ApproachView
from grasping.curvature_planner.finger_scan import Candidates, Scan
from grasping.curvature_planner.line_of_sight import Sight
from grasping.curvature_planner.ranking import Ranked, Rules
from grasping.curvature_planner.region_report import RegionMeasures

FloatArray = NDArray[np.float64]


class Backend(Protocol):
    """The functions that `CurvaturePlanner` spends its time in; the NumPy ones say what each does."""

    def short_side(self, cloud: FloatArray, axes: FloatArray, cell: float) -> tuple[float, float]:
        """`projection.short_side`."""

    def thin(self, cloud: FloatArray, axes: FloatArray, box: float, depth: float) -> FloatArray:
        """`projection.thin`."""

    def place(
        self, cloud: FloatArray, axes: FloatArray, table_height: float | None, cell: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, tuple[float, float]]:
        """`projection.place`."""

    def neighbours(
        self, others: FloatArray, axes: FloatArray, middle: FloatArray, reach: FloatArray, cell: float
    ) -> FloatArray:
        """`projection.neighbours`."""

    def look(
        self, cloud: FloatArray, obstacles: FloatArray, unseen: FloatArray, viewpoint: FloatArray
    ) -> tuple[FloatArray, FloatArray, float]:
        """`line_of_sight.look`."""

    def with_its_back(self, cloud: FloatArray, up: FloatArray, floor: float, cell: float, sight: Sight) -> FloatArray:
        """`unseen_back.with_its_back`."""

    def scan(
        self,
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

    def rank(self, view: ApproachView, candidates: Candidates, rules: Rules) -> Ranked:
        """`ranking.rank`."""

    def measure_regions(self, view: ApproachView, candidates: Candidates | None, slab_height: float) -> RegionMeasures:
        """`region_report.measure_regions`."""
