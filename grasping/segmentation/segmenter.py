"""From a frame of a scene to one cloud for each object on the table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import ConfigError, require_between
from grasping.geometry.clustering import by_label
from grasping.segmentation.boosted_trees import Relations
from grasping.segmentation.by_footprints import clusters_in_space, clusters_on_table
from grasping.segmentation.by_surfaces import WHOLE_RATHER, SurfaceGroups, give_hidden, group_by_surfaces
from grasping.segmentation.depth_holes import parts_over_holes
from grasping.segmentation.frame import Frame
from grasping.segmentation.object_rules import Limits, ObjectRules, Sorted, Tabletop, upward
from grasping.segmentation.planes import Plane, fit_all
from grasping.segmentation.published import PublishedSegmenter
from grasping.segmentation.scene import Cut, Rejected, Scene
from grasping.segmentation.surfaces import MOST_SURE, Surfaces
from grasping.segmentation.trained import trained_relations
from grasping.segmentation.working_image import WorkingImage
from grasping.validation import FARTHEST, unit_vector

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


ON_TABLE = 3.0  # times the table's noise
FITTED = 20_000  # points of the table that suffice for its plane


class Segmenter:
    """Crop in depth → table → surfaces → objects.

    A frame is cut into surfaces, and trees that were trained on simulated scenes say which of them are of one object,
    so that things are told apart that touch, lean, hide and lie on each other. A loose cloud is drawn as its camera saw
    it; where nobody knows from where (`viewpoint`), things are told apart by the places they stand on, and what touches
    is one. What is flat is found so far as it stands out of the table by more than the sensor's noise.

    depth_range: nearest and farthest distance from the frame's origin, m.
    plane_distance: RANSAC's inlier distance, m.
    plane_band: least and greatest distance (m) from the refined plane within which a point is table; between the two it
        is three times the plane's measured residual, so that an object of 12 mm survives noise of 1 to 2 mm.
    gap: between two objects of a loose cloud without viewpoint, m; at 1.2 gaps they are surely told apart, at 0.8 they
        are one.
    min_points, min_area, min_height: clusters of fewer points, of less area (m², across the line of sight) or lower (m,
        95 % of its points) are noise and unevenness of the table.
    max_extent: larger clusters are no objects for a hand, m. max_height: points higher above the table are left out, m.
    least_thing: how sure the trees must be, in [0, 1], that a low cluster is a thing, neither a wrinkle of the table
        nor a scrap.
    whole_rather: log odds by which two surfaces that adjoin rather are of one object: 0 as the trees say, more joins
        more, less cuts more, as suits a heap from which one thing is taken: two in one cost more there than a half.
    relations: file of `pecgrasp train-segmenter`, of another camera's trees; None: the package's own.
    seed: of RANSAC's draws; the same input gives the same scene.
    """

    def __init__(
        self,
        *,
        depth_range: tuple[float, float] = (0.0, 2.0),
        plane_distance: float = 0.01,
        plane_band: tuple[float, float] = (0.003, 0.010),
        gap: float = 0.015,
        min_points: int = 40,
        min_area: float = 2e-4,
        min_height: float = 0.002,
        max_extent: float = 0.45,
        max_height: float = 0.45,
        least_thing: float = 0.5,
        whole_rather: float = WHOLE_RATHER,
        relations: str | Path | None = None,
        seed: int = 0,
    ) -> None:
        for name, pair in (("depth_range", depth_range), ("plane_band", plane_band)):
            if len(pair) != 2 or not 0.0 <= pair[0] < pair[1] <= FARTHEST:
                raise ConfigError(f"{name} = {pair!r} must be two rising distances in metres")
        for name, value, least, most in (
            ("plane_distance", plane_distance, 1e-4, 0.5),
            ("gap", gap, 0.004, 0.5),
            ("min_points", min_points, 3, 10**7),
            ("min_area", min_area, 0.0, 1.0),
            ("min_height", min_height, 0.0, 1.0),
            ("max_extent", max_extent, 0.01, 100.0),
            ("max_height", max_height, 0.01, 100.0),
            ("least_thing", least_thing, 0.0, 1.0),
            ("whole_rather", whole_rather, -MOST_SURE, MOST_SURE),
        ):
            require_between(name, value, least, most)
        self.depth_range = depth_range
        self.plane_distance = plane_distance
        self.plane_band = plane_band
        self.gap = gap
        self.min_points = min_points
        self.min_area = min_area
        self.min_height = min_height
        self.max_extent = max_extent
        self.max_height = max_height
        self.least_thing = least_thing
        self.whole_rather = whole_rather
        self.relations = None if relations is None else Path(relations)
        self.seed = seed

    @staticmethod
    def published() -> PublishedSegmenter:
        """The dissertation's: plane within 0.02 m, outliers by 50 neighbours and 1.0 σ, clusters by 0.05 m."""
        return PublishedSegmenter()

    def segment(
        self,
        cloud: ArrayLike,
        *,
        up: ArrayLike | None = None,
        robot: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
    ) -> Scene:
        """Find the objects in a cloud (N, 3) or an organised frame (H, W, 3), m; NaN and (0, 0, 0) are invalid.

        up: (3,) away from the table, in the cloud's frame; without it see `find_table`. robot: one's own arm and hand
        where they are, in the cloud's frame: points of the surface (K, 3), at most 3 cm apart, or spheres (K, 4) that
        cover it, x, y, z and radius. What is within 2 cm of the points or 1.5 cm of the spheres is cut out first, and
        what it hides counts as not measured. viewpoint: (3,) where the camera stood, in the cloud's frame; without it
        the cloud's origin, unless that cannot be. Raises CloudError for input that is no cloud or has no valid point in
        range.
        """
        frame = Frame(cloud, self.depth_range, viewpoint, robot)
        plane, height = self._table(frame, None if up is None else unit_vector(up, name="up"))
        seen = self._without_ramps(frame, plane, height)
        image = frame.working_image(None if plane is None else plane.equation, seen.steady)
        if image is not None:
            return self._by_surfaces(frame, image, seen, plane, height)
        if plane is None or height is None:
            rules = ObjectRules(frame, self._limits, None)
            clusters = clusters_in_space(frame, np.flatnonzero(seen.steady), self.gap)
            found = rules.sort(frame.with_edges(clusters, seen.on_ramps))
            return frame.scene(None, found.objects, found.obstacles, 0)
        table = np.flatnonzero(np.abs(height) <= plane.band)
        above = self._not_too_tall(frame, np.flatnonzero(seen.steady & (height > plane.band)), height)
        frame.reject_below(plane.equation, np.flatnonzero(height < -plane.band))
        rules = ObjectRules(frame, self._limits, Tabletop(frame, plane.equation, height, table))
        clusters = clusters_on_table(frame, above, rules, self.gap)
        found = rules.sort(frame.with_edges(clusters, seen.on_ramps))
        return frame.scene(plane.equation, found.objects, found.obstacles, len(table))

    def surfaces(self, cloud: ArrayLike, *, with_table: bool = True) -> Surfaces | None:
        """The patches of a frame (H, W, 3) and their pairs, as `segment` meets them; None where it does without.

        with_table: whether a table is looked for. Raises CloudError as `segment` does.
        """
        frame = Frame(cloud, self.depth_range)
        plane, height = self._table(frame, None) if with_table else (None, None)
        equation = None if plane is None else plane.equation
        image = frame.working_image(equation, self._without_ramps(frame, plane, height).steady)
        return None if image is None else Surfaces(image, equation, self.max_height)

    def _without_ramps(self, frame: Frame, plane: Plane | None, height: NDArray | None) -> _Seen:
        """Leave out what hangs in the air above the table before surfaces are looked for: it joins what is apart."""
        above = frame.valid if plane is None or height is None else height > plane.band
        standing = np.flatnonzero(above)
        firm, on_ramps = frame.without_flying(standing, None if plane is None else plane.equation)
        steady = frame.valid.copy()
        steady[standing] = False
        steady[firm] = True
        return _Seen(steady, on_ramps)

    def _table(self, frame: Frame, up: FloatArray | None) -> tuple[Plane | None, NDArray | None]:
        """The table's plane, fitted to `FITTED` of its points or all, and the heights (N,) above it."""
        plane = frame.find_table(up, np.random.default_rng(self.seed), self.plane_distance, self.plane_band)
        if isinstance(plane, str):
            return None, None
        height = frame.heights(plane.equation)
        level = np.flatnonzero(np.abs(height) <= plane.band)
        plane = fit_all(plane, frame.points.take(level[:: max(1, len(level) // FITTED)], axis=0))
        return plane, frame.heights(plane.equation)

    def _by_surfaces(
        self, frame: Frame, image: WorkingImage, seen: _Seen, plane: Plane | None, height: NDArray | None
    ) -> Scene:
        equation = None if plane is None else plane.equation
        groups = group_by_surfaces(image, seen.steady, equation, self.max_height, self._relations, self.whole_rather)
        tabletop, table = None, np.empty(0, dtype=np.int64)
        if plane is not None and height is not None and groups.above_table is not None:
            table = self._table_around(frame, groups, seen, plane, height)
            height = _above_bent(height, groups.above_table, image, plane.equation)
            tabletop = Tabletop(frame, plane.equation, height, table)
        else:
            alone = seen.steady & (groups.number == 0)
            frame.reject("points", "isolated", np.flatnonzero(alone))
        chosen = np.flatnonzero(groups.number > 0)
        number = groups.number.take(chosen)
        number = number.astype(np.min_scalar_type(len(groups.whole)))  # of 16 bits at most they are sorted by radix
        clusters = frame.with_edges([chosen[members] for members in by_label(number)], seen.on_ramps)
        rules = ObjectRules(frame, self._limits, tabletop)
        found = self._over_holes(frame, rules, rules.sort(clusters, groups.thing, groups.whole), table)
        order = sorted(range(len(found.objects)), key=lambda i: -len(found.objects[i]))
        scene = frame.scene(equation, [found.objects[i] for i in order], found.obstacles, len(table))
        number_of = [found.number[i] for i in order]
        confidence = [float(groups.whole[number]) for number in number_of]
        return replace(scene, confidence=confidence, cuts=_cuts_between(number_of, groups))

    def _table_around(
        self, frame: Frame, groups: SurfaceGroups, seen: _Seen, plane: Plane, height: NDArray
    ) -> IntArray:
        """The table's points (T,); what is left beside the groups and the table is noted, why and how much."""
        above = groups.above_table
        assert above is not None
        level = (np.abs(height) <= plane.band) | (np.abs(above) <= np.float32(ON_TABLE * groups.table_noise))
        if frame.shape is None:
            give_hidden(frame.points, groups.number, np.flatnonzero(~level & (groups.number == 0) & (height > 0)))
        free = seen.steady & (groups.number == 0)
        left = np.flatnonzero(free & ~level)
        is_above = height.take(left) > 0
        alone = self._not_too_tall(frame, left[is_above], height)
        frame.reject("points", "isolated, or too little above the table for the sensor's noise", alone)
        frame.reject_below(plane.equation, left[~is_above])
        return np.flatnonzero(level & free)

    def _over_holes(self, frame: Frame, rules: ObjectRules, found: Sorted, table: IntArray) -> Sorted:
        """The objects, with those joined that only a hole in the depth divides."""
        if len(found.objects) < 2 or frame.sight is None or rules.tabletop is None:
            return found
        near = 2.0 * rules.tabletop.pitch
        level = rules.tabletop.level
        groups = parts_over_holes(found.objects, *frame.measured(), frame.sight.viewpoint, table, level, near)
        if len(groups) == len(found.objects):
            return found
        objects = [np.sort(np.concatenate([found.objects[i] for i in group])) for group in groups]
        if any(rules.extent(points) > self.max_extent for points in objects):
            return found
        largest = [max(group, key=lambda i: len(found.objects[i])) for group in groups]
        return Sorted(objects, [found.number[i] for i in largest], found.obstacles)

    def _not_too_tall(self, frame: Frame, above: IntArray, height: NDArray) -> IntArray:
        """Those of the points above the table that are not higher than `max_height`; the others are noted."""
        tall = height.take(above) > self.max_height
        if tall.any():
            way_out = f"max_height={upward(height.take(above).max()):g}"
            why = f"more than {self.max_height:g} m above the table"
            frame.reject("points", why, above[tall], way_out)
        return above[~tall]

    @property
    def _limits(self) -> Limits:
        return Limits(self.min_points, self.min_area, self.min_height, self.max_extent, self.least_thing)

    @cached_property
    def _relations(self) -> Relations:
        return trained_relations(self.relations)


@dataclass(frozen=True)
class _Seen:
    """steady: (N,) the valid points that do not hang in the air. on_ramps: (R,) of those that do, those on ramps, which
    may be an object's edge.
    """

    steady: NDArray[np.bool_]
    on_ramps: IntArray


def _cuts_between(number: list[int], groups: SurfaceGroups) -> list[Cut]:
    """Where the objects adjoin that the groups of these numbers became, and how sure they are two."""
    place = {each: rank for rank, each in enumerate(number)}
    cuts = [
        Cut(min(place[one], place[other]), max(place[one], place[other]), sure)
        for (one, other), sure in groups.cuts.items()
        if one in place and other in place
    ]
    return sorted(cuts, key=lambda cut: (cut.first, cut.second))


def _above_bent(height: NDArray, above: NDArray, image: WorkingImage, plane: FloatArray) -> NDArray:
    """(N,) m above the table as the sensor bends it. above: (N,) likewise, 1/m; height: (N,) above the plane, m."""
    camera = float(plane[:3] @ image.viewpoint + plane[3])
    own = image.point_inverse_depth
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # Along the line of sight a point is above / (own (own − above)) nearer, and that falls (camera − height) own.
        return np.asarray(above / (own - above) * (camera - height))


__all__ = ["PublishedSegmenter", "Rejected", "Scene", "Segmenter"]
