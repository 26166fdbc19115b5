"""From a frame of a scene to one cloud for each object on the table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import ConfigError, require_between
from grasping.geometry.clustering import by_label, voxel_clusters
from grasping.segmentation.depth_holes import parts_over_holes
from grasping.segmentation.footprints import convex_outline, label_footprints, spacing
from grasping.segmentation.frame import Frame
from grasping.segmentation.planes import basis, fit_all
from grasping.segmentation.published import PublishedSegmenter
from grasping.segmentation.rims import join_walls
from grasping.segmentation.saddles import parts_above_saddles
from grasping.segmentation.scene import Rejected, Scene
from grasping.segmentation.table_gaps import parts_by_table
from grasping.validation import FARTHEST, unit_vector

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BESIDE_TABLE = 0.01  # m outside of the seen table's outline
_SMALL = "small"
_BESIDE = "beside the table"


class Segmenter:
    """Crop in depth → table → outliers → clusters.

    Things are told apart by their footprints on the table. Seen along its normal, parts of one object that hide each
    other from the camera still touch, and neighbours a gap apart do not. Without a table the clusters are Euclidean.
    What touches or is stacked is one object, and what another hides the middle of may be two. Of what is flat only so
    much is found as the sensor's noise leaves: an object of 12 mm up to a residual of the table of about 3 mm.

    depth_range: nearest and farthest distance from the frame's origin, m.
    plane_distance: RANSAC's inlier distance, m.
    plane_band: least and greatest distance (m) from the refined plane within which a point is table; between the two it
        is three times the plane's measured residual, so that an object of 12 mm survives noise of 1 to 2 mm.
    gap: between two objects, m; at 1.2 gaps they are surely told apart, at 0.8 they are one.
    min_points, min_area, min_height: clusters of fewer points, of less area (m², across the line of sight) or lower (m,
        95 % of its points) are noise and unevenness of the table.
    max_extent: larger clusters are no objects for a hand, m. max_height: points higher above the table are left out, m.
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
        min_height: float = 0.008,
        max_extent: float = 0.45,
        max_height: float = 0.45,
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
        up_vector = None if up is None else unit_vector(up, name="up")
        rng = np.random.default_rng(self.seed)
        plane = frame.find_table(up_vector, rng, self.plane_distance, self.plane_band)
        if isinstance(plane, str):
            return self._without_table(frame)
        height = frame.heights(plane.equation)
        plane = fit_all(plane, frame.points.take(np.flatnonzero(np.abs(height) <= plane.band), axis=0))
        height = frame.heights(plane.equation)
        table = np.flatnonzero(np.abs(height) <= plane.band)
        above = np.flatnonzero(height > plane.band)
        tall = height.take(above) > self.max_height
        if tall.any():
            way_out = f"max_height={_upward(height.take(above).max()):g}"
            why = f"more than {self.max_height:g} m above the table"
            frame.reject("points", why, above[tall], way_out)
        frame.reject_below(plane.equation, np.flatnonzero(height < -plane.band))
        chosen, on_ramps = frame.without_flying(above[~tall], plane.equation)
        level = basis(plane.equation[:3])
        flat = frame.points.take(chosen, axis=0) @ level
        seen = frame.points.take(table[:: max(1, len(table) // 5000)], axis=0) @ level
        pitch = spacing(seen, len(table))
        labels = label_footprints(flat, self.gap, pitch)
        on_table = _OnTable(level, height, flat, convex_outline(seen), pitch)
        kept, obstacles = self._sort(frame, chosen, labels, on_table)
        kept = self._over_holes(frame, frame.with_edges(kept, on_ramps), table, on_table)
        return frame.scene(plane.equation, kept, obstacles, len(table))

    def _without_table(self, frame: Frame) -> Scene:
        chosen, on_ramps = frame.without_flying(np.flatnonzero(frame.valid))
        labels = voxel_clusters(frame.points.take(chosen, axis=0).astype(np.float64), self.gap)
        kept, obstacles = self._sort(frame, chosen, labels, None)
        return frame.scene(None, frame.with_edges(kept, on_ramps), obstacles, 0)

    def _sort(
        self, frame: Frame, chosen: IntArray, labels: IntArray, on_table: _OnTable | None
    ) -> tuple[list[IntArray], list[IntArray]]:
        """Split the clusters into objects, the largest first, and others that may be in the way."""
        kept: list[IntArray] = []
        obstacles: list[IntArray] = []
        small: list[IntArray] = []
        frame.reject("points", "isolated", chosen[labels < 0])
        for cluster in by_label(labels):
            # What is no object whatever its parts are is not taken apart.
            why_whole = self._too_little(frame, chosen[cluster], on_table)
            if why_whole is None and on_table is not None and on_table.beside(cluster, every_one=True):
                why_whole = _BESIDE
            parts = [cluster] if why_whole else self._parts(frame, chosen, cluster, on_table)
            for members in parts:
                points, why = chosen[members], why_whole
                if len(parts) > 1:
                    why = self._too_little(frame, points, on_table)
                if why is None:
                    why = self._misplaced(frame, points, members, on_table)
                if why is None:
                    kept.append(points)
                elif why == _SMALL:
                    small.append(points)
                else:
                    frame.reject("cluster", why, points, self._way_out(frame, points, on_table, why))
                    if not why.startswith("only"):
                        obstacles.append(points)
        if on_table is not None and len(kept) > 1:
            few = [points[:: max(1, len(points) // 2000)] for points in kept]  # suffice for their edges
            walls = [
                (frame.points.take(points, axis=0) @ on_table.level, on_table.height.take(points)) for points in few
            ]
            kept = [np.concatenate([kept[i] for i in numbers]) for numbers in join_walls(walls)]
        least = f"fewer than {self.min_points} points or less than {self.min_area * 1e4:g} cm²"
        if small:
            frame.reject("points", f"in {len(small)} clusters of {least}", np.concatenate(small))
        return sorted(kept, key=lambda points: -len(points)), obstacles

    def _over_holes(self, frame: Frame, kept: list[IntArray], table: IntArray, on_table: _OnTable) -> list[IntArray]:
        """The objects, the largest first, with those joined that only a hole in the depth divides."""
        if len(kept) < 2 or frame.sight is None:
            return kept
        groups = parts_over_holes(
            kept, *frame.measured(), frame.sight.viewpoint, table, on_table.level, 2.0 * on_table.pitch
        )
        joined = [np.sort(np.concatenate([kept[i] for i in numbers])) for numbers in groups]
        if len(joined) == len(kept) or any(self._extent(frame, points) > self.max_extent for points in joined):
            return kept
        return sorted(joined, key=lambda points: -len(points))

    def _parts(self, frame: Frame, chosen: IntArray, members: IntArray, on_table: _OnTable | None) -> list[IntArray]:
        """A cluster's members, by the parts between which the table is seen; what is then too large, by what it is
        above the feet of its parts.
        """
        if on_table is None:
            return [members]
        points = chosen[members]
        least = max(self.min_points, round(len(members) * self.min_area / frame.area(points, on_table.pitch)))
        parts = [members]
        if frame.shape is not None:
            flat = on_table.flat.take(members, axis=0)
            parts = [
                members[part] for part in by_label(parts_by_table(points, flat, on_table.height, frame.shape[1], least))
            ]
        done: list[IntArray] = []
        while parts:
            part = parts.pop()
            group = None
            if self._extent(frame, chosen[part]) > self.max_extent:
                flat, height = on_table.flat.take(part, axis=0), on_table.height.take(chosen[part])
                group = parts_above_saddles(flat, height, self.gap, on_table.pitch, least)
            if group is None:
                done.append(part)
            else:
                parts += [part[each] for each in by_label(group)]
        return done

    @staticmethod
    def _extent(frame: Frame, points: IntArray) -> float:
        coordinates = np.ascontiguousarray(frame.points.take(points, axis=0).T)  # extremes over long rows are fast
        return float(np.ptp(coordinates, axis=1).max())

    def _too_little(self, frame: Frame, points: IntArray, on_table: _OnTable | None) -> str | None:
        """Why so few or so low points are no object."""
        if len(points) < self.min_points:
            return _SMALL
        known = on_table is not None or frame.sight is not None
        if known and frame.area(points, 0.0 if on_table is None else on_table.pitch) < self.min_area:
            return _SMALL
        if on_table is not None and (top := _upper(on_table.height.take(points))) < self.min_height:
            return f"only {top * 1e3:.0f} mm high"
        return None

    def _misplaced(self, frame: Frame, points: IntArray, members: IntArray, on_table: _OnTable | None) -> str | None:
        """Why what is large enough is no object on the table."""
        if (extent := self._extent(frame, points)) > self.max_extent:
            return f"{extent:.2f} m large, more than {self.max_extent:g} m"
        return _BESIDE if on_table is not None and on_table.beside(members) else None

    def _way_out(self, frame: Frame, points: IntArray, on_table: _OnTable | None, why: str) -> str:
        """The setting with which a cluster would be an object, empty where there is none."""
        if why == _BESIDE:
            return ""
        if on_table is not None and why.startswith("only"):
            return f"min_height={np.floor(_upper(on_table.height.take(points)) * 1e3) / 1e3:g}"
        return f"max_extent={_upward(self._extent(frame, points)):g}"


@dataclass(frozen=True)
class _OnTable:
    """height: (N,) of the frame's points above the table. flat: (C, 2) where the chosen ones are on it. outline: the
    edges of what is seen of it. pitch: m between its points. level: (3, 2) its basis.
    """

    level: FloatArray
    height: NDArray
    flat: NDArray
    outline: FloatArray | None
    pitch: float

    def beside(self, members: IntArray, *, every_one: bool = False) -> bool:
        """Whether the middle of these points, or every one of them, lies outside of the table's outline."""
        if self.outline is None:
            return False
        flat = self.flat.take(members, axis=0)
        if not every_one:
            return _outside(self.outline, flat.mean(axis=0, keepdims=True))
        return _outside(self.outline, flat[:: max(1, len(flat) // 100)])


def _upper(height: NDArray) -> float:
    """What 95 % of the heights are at most."""
    last = int(0.95 * (len(height) - 1))
    return float(np.partition(height, last)[last])


def _upward(value: float) -> float:
    """The next twentieth of a metre above."""
    return float(np.ceil(20 * value + 1e-6) / 20)


def _outside(outline: FloatArray, flat: NDArray) -> bool:
    """Whether all of these points (M, 2) of the plane lie outside of the table's outline."""
    beyond = flat @ outline[:, :2].T + outline[:, 2] > BESIDE_TABLE
    return bool(beyond.any(axis=1).all())


__all__ = ["PublishedSegmenter", "Rejected", "Scene", "Segmenter"]
