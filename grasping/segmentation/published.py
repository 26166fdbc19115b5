"""The scene as the dissertation segments it: RANSAC plane, statistical outliers, Euclidean clusters."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.errors import ConfigError
from grasping.geometry.clustering import by_label, voxel_clusters
from grasping.segmentation.frame import Frame
from grasping.segmentation.scene import Scene
from grasping.validation import unit_vector

FloatArray = NDArray[np.float64]


class PublishedSegmenter:
    """The dissertation's segmentation: RANSAC plane, statistical outliers, Euclidean clusters.

    plane_distance: points this near to the plane are table, m. mean_k, std: a point is an outlier where its mean
    distance to its mean_k neighbours exceeds the mean of all by more than std standard deviations. eps: cluster
    tolerance, m. min_points: smaller clusters are dropped (not in the text). depth_range, seed: as in `Segmenter`.
    """

    def __init__(
        self,
        *,
        plane_distance: float = 0.02,
        mean_k: int = 50,
        std: float = 1.0,
        eps: float = 0.05,
        min_points: int = 40,
        depth_range: tuple[float, float] = (0.0, 2.0),
        seed: int = 0,
    ) -> None:
        for name, value in (("plane_distance", plane_distance), ("mean_k", mean_k), ("std", std), ("eps", eps)):
            if not (math.isfinite(value) and value > 0):
                raise ConfigError(f"{name} = {value!r} must be positive")
        self.plane_distance = plane_distance
        self.mean_k = mean_k
        self.std = std
        self.eps = eps
        self.min_points = min_points
        self.depth_range = depth_range
        self.seed = seed

    def segment(
        self,
        cloud: ArrayLike,
        *,
        up: ArrayLike | None = None,
        robot: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
    ) -> Scene:
        """As `Segmenter.segment`."""
        frame = Frame(cloud, self.depth_range, viewpoint, robot)
        up_vector = None if up is None else unit_vector(up, name="up")
        rng = np.random.default_rng(self.seed)
        band = (0.999 * self.plane_distance, self.plane_distance)
        plane = frame.find_table(up_vector, rng, self.plane_distance, band)
        n_table = 0
        if isinstance(plane, str):
            chosen = np.flatnonzero(frame.valid)
        else:
            height = frame.heights(plane.equation)
            chosen = np.flatnonzero(height > self.plane_distance)
            below = np.flatnonzero(height < -self.plane_distance)
            frame.reject_below(plane.equation, below)
            n_table = frame.count - len(below) - len(chosen)
        points = frame.points.take(chosen, axis=0).astype(np.float64)
        inliers = _statistical_inliers(points, self.mean_k, self.std)
        frame.reject("points", "outliers", chosen[~inliers])
        chosen = chosen[inliers]
        clusters = [chosen[members] for members in by_label(voxel_clusters(points[inliers], self.eps))]
        kept = sorted(
            (members for members in clusters if len(members) >= self.min_points), key=lambda members: -len(members)
        )
        few = [members for members in clusters if len(members) < self.min_points]
        if few:
            frame.reject("points", f"{len(few)} clusters of fewer than {self.min_points}", np.concatenate(few))
        return frame.scene(None if isinstance(plane, str) else plane.equation, kept, [], n_table)


def _statistical_inliers(points: FloatArray, mean_k: int, std: float) -> NDArray[np.bool_]:
    if len(points) < 3:
        return np.ones(len(points), dtype=bool)
    nearest, _ = cKDTree(points).query(points, k=min(mean_k + 1, len(points)))
    mean = nearest[:, 1:].mean(axis=1)
    return np.asarray(mean <= mean.mean() + std * mean.std())
