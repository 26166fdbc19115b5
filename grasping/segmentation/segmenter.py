"""From a frame of a scene to one cloud for each object on the table."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.errors import ConfigError, require_between
from grasping.geometry.clustering import by_label, voxel_clusters
from grasping.segmentation.footprints import convex_outline, label_footprints, spacing
from grasping.segmentation.frame import Frame
from grasping.segmentation.published import PublishedSegmenter
from grasping.segmentation.scene import Rejected, Scene
from grasping.segmentation.table_gaps import split_by_table
from grasping.segmentation.table_plane import SAMPLED, basis, find_table, fit_all
from grasping.validation import FARTHEST, as_cloud, unit_vector

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

BESIDE_TABLE = 0.01  # m outside of the seen table's outline


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
    min_points, min_height: smaller and lower (m, 95 % of its points) clusters are noise and unevenness of the table.
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
        gripper: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
    ) -> Scene:
        """Find the objects in a cloud (N, 3) or an organised frame (H, W, 3), m; NaN and (0, 0, 0) are invalid.

        up: (3,) away from the table, in the cloud's frame; without it see `find_table`. gripper: (K, 3) points of one's
        own hand, for `touches_gripper`. viewpoint: (3,) where the camera stood, in the cloud's frame; without it the
        cloud's origin, unless that cannot be. Raises CloudError for input that is no cloud or has no valid point in
        range.
        """
        frame = Frame(cloud, self.depth_range, viewpoint)
        up_vector = None if up is None else unit_vector(up, name="up")
        hand = None if gripper is None else as_cloud(gripper, name="gripper")
        rng = np.random.default_rng(self.seed)
        sample = frame.sample(SAMPLED, rng)
        plane = find_table(sample, up_vector, rng, coarse=self.plane_distance, band=self.plane_band)
        if isinstance(plane, str):
            return self._without_table(frame, plane, hand)
        height = frame.heights(plane.equation)
        plane = fit_all(plane, frame.points.take(np.flatnonzero(np.abs(height) <= plane.band), axis=0))
        height = frame.heights(plane.equation)
        table = np.flatnonzero(np.abs(height) <= plane.band)
        above = np.flatnonzero(height > plane.band)
        tall = height.take(above) > self.max_height
        frame.reject("points", f"more than {self.max_height:g} m above the table", int(np.count_nonzero(tall)))
        frame.reject("points", "below the table", frame.count - len(table) - len(above))
        chosen = frame.without_flying(above[~tall])
        level = basis(plane.equation[:3])
        flat = frame.points.take(chosen, axis=0) @ level
        seen = frame.points.take(table[:: max(1, len(table) // 5000)], axis=0) @ level
        labels = label_footprints(flat, self.gap, spacing(seen, len(table)))
        if frame.shape is not None:
            labels = split_by_table(labels, chosen, flat, height, frame.shape, self.min_points)
        clusters = self._sort(frame, chosen, labels, height, flat, convex_outline(seen))
        return frame.scene(plane.equation, *clusters, hand, len(table))

    def _without_table(self, frame: Frame, why: str, hand: FloatArray | None) -> Scene:
        frame.rejected.insert(0, Rejected("plane", why, frame.count))
        chosen = frame.without_flying(np.flatnonzero(frame.valid))
        labels = voxel_clusters(frame.points.take(chosen, axis=0).astype(np.float64), self.gap)
        return frame.scene(None, *self._sort(frame, chosen, labels, None, None, None), hand, 0)

    def _sort(
        self,
        frame: Frame,
        chosen: IntArray,
        labels: IntArray,
        height: NDArray | None,
        flat: NDArray | None,
        outline: FloatArray | None,
    ) -> tuple[list[IntArray], list[IntArray]]:
        """Split the clusters into objects, the largest first, and others that may be in the way.

        height (N,) of the frame's points above the table, flat (C, 2) the chosen ones in the table's plane, outline
        the edges of what is seen of it.
        """
        kept, obstacles = [], []
        frame.reject("points", "isolated", int(np.count_nonzero(labels < 0)))
        few, few_points = 0, 0
        for members in by_label(labels):
            points = chosen[members]
            if len(members) < self.min_points:
                few, few_points = few + 1, few_points + len(members)
                continue
            if height is not None and (top := _upper(height.take(points))) < self.min_height:
                frame.reject("cluster", f"only {top * 1e3:.0f} mm high", len(members))
                continue
            coordinates = np.ascontiguousarray(frame.points.take(points, axis=0).T)  # extremes over long rows are fast
            extent = float(np.ptp(coordinates, axis=1).max())
            if extent > self.max_extent:
                frame.reject("cluster", f"{extent:.2f} m large, more than {self.max_extent:g} m", len(members))
                obstacles.append(points)
            elif flat is not None and outline is not None and _outside(outline, flat.take(members, axis=0)):
                frame.reject("cluster", "beside the table", len(members))
                obstacles.append(points)
            else:
                kept.append(points)
        frame.reject("points", f"{few} clusters of fewer than {self.min_points}", few_points)
        return sorted(kept, key=lambda points: -len(points)), obstacles


def _upper(height: NDArray) -> float:
    """What 95 % of the heights are at most."""
    last = int(0.95 * (len(height) - 1))
    return float(np.partition(height, last)[last])


def _outside(outline: FloatArray, flat: NDArray) -> bool:
    """Whether the middle of these points of the plane lies outside of the table's outline."""
    return bool((outline[:, :2] @ flat.mean(axis=0) + outline[:, 2] > BESIDE_TABLE).any())


__all__ = ["PublishedSegmenter", "Rejected", "Scene", "Segmenter"]
