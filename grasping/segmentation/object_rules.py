"""Which clusters of points are objects for a hand: large enough, high enough, not too large, and on the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.footprints import OF_OUTLINE, convex_outline, spacing
from grasping.segmentation.frame import Frame
from grasping.segmentation.planes import basis

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BESIDE_TABLE = 0.01  # m outside of the seen table's outline
OUTSIDE = 0.9  # of a thing's points, beside the table
FEW = 200  # points that suffice to say so
SAMPLED, STRAY = 4000, 0.0008  # points that suffice for their extent, and the share of them that may lie anywhere
SEEN_OF_TABLE = 5000  # points that suffice for its outline
SMALL = "small"
BESIDE = "beside the table"
NO_THING = "low, and by its surface more likely a wrinkle of the table, or a scrap, than a thing"
BACKGROUND = "beyond the view, and by its surface surely part of the background"
SURELY_NONE = 0.1  # of `least_thing`: the trees have seen few backgrounds, and no real one
WRINKLE = 0.015  # m above the table
SCRAP = 2.0  # a low scrap that is whole with a quarter is a thing with a half


@dataclass(frozen=True)
class Limits:
    """The segmenter's settings of these names."""

    min_points: int
    min_area: float
    min_height: float
    max_extent: float
    least_thing: float


class Tabletop:
    """The table under a frame's points. heights: (N,) of the points above it, m. level: (3, 2) its basis. outline: the
    edges of what is seen of it, or None. pitch: m between its points.
    """

    def __init__(self, frame: Frame, plane: FloatArray, heights: NDArray, table: IntArray) -> None:
        self.heights = heights
        self.level = basis(plane[:3])
        self._seen = seen = frame.points.take(table[:: max(1, len(table) // SEEN_OF_TABLE)], axis=0) @ self.level
        self.pitch = spacing(seen, max(len(table), 1))
        self.outline = convex_outline(seen)

    def under(self, frame: Frame, objects: Sequence[IntArray]) -> None:
        """Count the places over which these objects (M,) are seen as the table's, too: they hide it."""
        few = [frame.points.take(points[:: max(1, len(points) // FEW)], axis=0) @ self.level for points in objects]
        places = np.concatenate([self._seen[:: max(1, len(self._seen) // OF_OUTLINE)], *few])
        self.outline = convex_outline(places, most=len(places))

    def beside(self, frame: Frame, points: IntArray, share: float = OUTSIDE) -> bool:
        """Whether at least this share of the points lies outside of the table's outline.

        What stands on a table hides some of it, so that much of a thing at its edge lies outside of what is seen.
        """
        if self.outline is None:
            return False
        flat = frame.points.take(points[:: max(1, len(points) // FEW)], axis=0) @ self.level
        beyond = flat @ self.outline[:, :2].T + self.outline[:, 2] > BESIDE_TABLE
        return bool(np.count_nonzero(beyond.any(axis=1)) >= share * len(flat))


@dataclass
class Sorted:
    """Objects and what may be in a gripper's way, as points (M,) of the frame; number: of each object's cluster."""

    objects: list[IntArray] = field(default_factory=list)
    number: list[int] = field(default_factory=list)
    obstacles: list[IntArray] = field(default_factory=list)


class ObjectRules:
    """Sorts clusters of a frame into objects, obstacles and what is too little to be either, and notes why."""

    def __init__(self, frame: Frame, limits: Limits, tabletop: Tabletop | None) -> None:
        self.frame, self.limits, self.tabletop = frame, limits, tabletop

    def sort(
        self, clusters: Sequence[IntArray], thing: FloatArray | None = None, whole: FloatArray | None = None
    ) -> Sorted:
        """The objects among the clusters, in their order. thing, whole: how sure, in [0, 1], each is one, and a whole
        one; given together.
        """
        result = Sorted()
        small: list[IntArray] = []
        reasons = [self.too_little(points) or self.misplaced(points) for points in clusters]
        if self.tabletop is not None and BESIDE in reasons and None in reasons:
            self.tabletop.under(self.frame, [clusters[i] for i, why in enumerate(reasons) if why is None])
            reasons = [self.misplaced(clusters[i]) if why == BESIDE else why for i, why in enumerate(reasons)]
        for number, (points, why) in enumerate(zip(clusters, reasons, strict=True)):
            if why == SMALL:
                small.append(points)
                continue
            sure = 1.0
            if thing is not None and whole is not None:
                sure = self._sure(points, float(thing[number]), float(whole[number]))
            why = why or self._no_thing(points, sure)
            if why is None:
                result.objects.append(points)
                result.number.append(number)
                continue
            self.frame.reject("cluster", why, points, self._way_out(points, why, sure))
            if not why.startswith("only") and why != NO_THING:  # fingers pass over a wrinkle
                result.obstacles.append(points)
        limits = self.limits
        least = f"fewer than {limits.min_points} points or less than {limits.min_area * 1e4:g} cm²"
        few = np.concatenate([np.empty(0, dtype=np.int64), *small])
        self.frame.reject("points", f"in {len(small)} clusters of {least}", few)
        return result

    def extent(self, points: IntArray) -> float:
        """The longest side of the box around these points but for stray ones, along the frame's axes, m."""
        coordinates = self.frame.points.take(points[:: max(1, len(points) // SAMPLED)], axis=0)
        stray = int(STRAY * len(coordinates))
        last = len(coordinates) - 1 - stray
        ordered = np.partition(coordinates.T, (stray, last), axis=1)
        return float((ordered[:, last] - ordered[:, stray]).max())

    def area(self, points: IntArray) -> float:
        """What these points show across the line of sight, m²."""
        return self.frame.area(points, 0.0 if self.tabletop is None else self.tabletop.pitch)

    def too_little(self, points: IntArray) -> str | None:
        """Why so few or so low points are no object."""
        if len(points) < self.limits.min_points:
            return SMALL
        known = self.tabletop is not None or self.frame.sight is not None
        if known and self.area(points) < self.limits.min_area:
            return SMALL
        if self.tabletop is not None and (top := _upper(self.tabletop.heights.take(points))) < self.limits.min_height:
            return f"only {top * 1e3:.0f} mm high"
        return None

    def misplaced(self, points: IntArray) -> str | None:
        """Why what is large enough is no object on the table."""
        if (extent := self.extent(points)) > self.limits.max_extent:
            return f"{extent:.2f} m large, more than {self.limits.max_extent:g} m"
        return BESIDE if self.tabletop is not None and self.tabletop.beside(self.frame, points) else None

    def _sure(self, points: IntArray, thing: float, whole: float) -> float:
        """How sure, in [0, 1], a cluster is a thing: where it is low, no surer than twice that it is a whole one."""
        return min(thing, SCRAP * whole) if self._flat(points) else thing

    def _no_thing(self, points: IntArray, sure: float) -> str | None:
        """Why the trees' word is taken that a cluster is none: it is low, or goes on beyond the view as walls do."""
        if sure >= self.limits.least_thing:
            return None
        if self._flat(points):
            return NO_THING
        return BACKGROUND if sure < SURELY_NONE * self.limits.least_thing and self.frame.cut_off(points) else None

    def _flat(self, points: IntArray) -> bool:
        """Whether a cluster is so low that it may be a wrinkle of the table."""
        return self.tabletop is not None and _upper(self.tabletop.heights.take(points)) < WRINKLE

    def _way_out(self, points: IntArray, why: str, sure: float) -> str:
        """The setting with which a cluster would be an object, empty where there is none."""
        if why == BESIDE:
            return ""
        if why in (NO_THING, BACKGROUND):
            return f"least_thing={np.floor(100 * sure) / 100:g}"
        if self.tabletop is not None and why.startswith("only"):
            return f"min_height={np.floor(_upper(self.tabletop.heights.take(points)) * 1e3) / 1e3:g}"
        return f"max_extent={upward(self.extent(points)):g}"


def _upper(height: NDArray) -> float:
    """What 95 % of the heights are at most."""
    last = int(0.95 * (len(height) - 1))
    return float(np.partition(height, last)[last])


def upward(value: float) -> float:
    """The next twentieth of a metre above."""
    return float(np.ceil(20 * value + 1e-6) / 20)
