"""The lateral-curvature planner exactly as the dissertation's chapter 5 specifies it.

What its text leaves open is a named parameter here; the defaults follow the author's public release where it has a
value. `CurvaturePlanner` is the planner for a real arm; this one is what it is measured against.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.clouds import object_cloud, workspace
from grasping.curvature import surface_variation, variation_at
from grasping.errors import ConfigError
from grasping.grasp import Grasp, GraspPlan, RegionReport, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.primitives import all_alike, primitive_of
from grasping.regions import euclidean_clusters, object_axes, principal_axes, slabs, thinned, way_in

FloatArray = NDArray[np.float64]


class PublishedPlanner:
    """PCA → slabs and their clusters → primitives → smallest sum of lateral curvatures (chapter 5).

    gripper: W_g is its stroke, H_g its finger width.
    n_points: the cloud is thinned to this many points, as the thresholds depend on density (256, inferred).
    neighbour_divisor: n of the neighbourhoods: k = N_region / n for the primitive (at least 3), 2 N_region / n for a
        lateral curvature (at least 4). Public release: 6 by default, 4 in a launch file.
    similar_length: regions whose lengths differ by no more are alike, m (public release: 8 mm).
    curvature_floor: a region with P at or below it is not taken; guards against almost empty neighbourhoods. Public
        release; 0 switches it off.
    slab_points: a slab needs more points than this (public release: 8).
    cluster_tolerance, cluster_points: Euclidean clusters in a slab, m, and their least and greatest number of points
        (public release: 0.02 or 0.03 m, 5 to 100).
    tip_clearance: the pads' tips are kept this far above a known table, m. Not in the text; without a table no effect.

    The closing axis is the region's own axis nearest to the object's x, the approach its z. Where `up` is given the
    approach is straight down instead, and the closing axis the most horizontal of the region's x and z. The text
    has no rule for the approach.
    """

    def __init__(
        self,
        gripper: Gripper = ROBOTIQ_2F_140,
        *,
        n_points: int = 256,
        neighbour_divisor: int = 6,
        similar_length: float = 0.008,
        curvature_floor: float = 0.016,
        slab_points: int = 8,
        cluster_tolerance: float = 0.02,
        cluster_points: tuple[int, int] = (5, 100),
        tip_clearance: float = 0.004,
    ) -> None:
        for name, value, least in (
            ("n_points", n_points, 16),
            ("neighbour_divisor", neighbour_divisor, 1),
            ("similar_length", similar_length, 0.0),
            ("curvature_floor", curvature_floor, 0.0),
            ("slab_points", slab_points, 0),
            ("cluster_tolerance", cluster_tolerance, 1e-6),
            ("tip_clearance", tip_clearance, 0.0),
        ):
            if not (math.isfinite(value) and value >= least):
                raise ConfigError(f"{name} = {value!r} must be at least {least}")
        if len(cluster_points) != 2 or not 1 <= cluster_points[0] <= cluster_points[1]:
            raise ConfigError(f"cluster_points = {cluster_points!r} must be (least, greatest), at least 1")
        self.gripper = gripper
        self.n_points = n_points
        self.neighbour_divisor = neighbour_divisor
        self.similar_length = similar_length
        self.curvature_floor = curvature_floor
        self.slab_points = slab_points
        self.cluster_tolerance = cluster_tolerance
        self.cluster_points = (cluster_points[0], cluster_points[1])
        self.tip_clearance = tip_clearance

    def plan(
        self,
        points: ArrayLike,
        *,
        up: ArrayLike | None = None,
        table: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
    ) -> GraspPlan:
        """Plan on the cloud (N, 3) of one object, m. Obstacles are checked for sense but, as published, not avoided.

        Raises CloudError and ConfigError for input that is none.
        """
        cloud = object_cloud(points)
        up_vector, plane, _ = workspace(up, table, obstacles)
        cloud = thinned(cloud, self.n_points)
        centroid = cloud.mean(axis=0)
        axes = object_axes(cloud)
        local = (cloud - centroid) @ axes
        scene = (up_vector, plane)

        if np.ptp(local[:, 1]) <= self.gripper.finger_width:
            grasp = self._grasp(cloud, axes, scene, "primitive", None, {})
            wide = f"the object is small, but {grasp.width * 1e3:.0f} mm wide; the gripper opens {self._stroke_mm} mm"
            return plan_from([grasp] if grasp.width <= self.gripper.stroke else [], [], wide)

        regions = self._regions(cloud, local)
        if not regions:
            return plan_from([], [], f"no slab of the object has more than {self.slab_points} points")
        by_curvature = sorted(regions, key=lambda region: region.curvature)
        primitives = [region.primitive for region in by_curvature]
        if all_alike(primitives, [region.width for region in by_curvature], self.similar_length):
            grasp = self._grasp(cloud, axes, scene, "primitive", None, {})
            width = max(grasp.width, *(region.width for region in regions))
            reason = (
                f"the object is one {primitives[0]}, {width * 1e3:.0f} mm wide; the gripper opens {self._stroke_mm} mm"
            )
            return plan_from([grasp] if width <= self.gripper.stroke else [], regions, reason)

        candidates = []
        for index, region in enumerate(regions):
            if region.verdict == "candidate":
                own = _aligned(region.points, axes)
                terms = {"curvature": region.curvature, "length": region.width}
                grasp = self._grasp(region.points, own, scene, "region", index, terms)
                if grasp.width <= self.gripper.stroke:
                    candidates.append(grasp)
                else:
                    wide = f"too wide across its own axes: {grasp.width * 1e3:.0f} mm"
                    regions[index] = replace(region, verdict=wide)
        return plan_from(candidates, regions, self._no_region(regions))

    @property
    def _stroke_mm(self) -> str:
        return f"{self.gripper.stroke * 1e3:.0f}"

    def _no_region(self, regions: list[RegionReport]) -> str:
        """A sentence on why none of the regions is a candidate."""
        widths = [region.width for region in regions if region.verdict.startswith("too wide")]
        parts = []
        if widths:
            parts.append(f"{len(widths)} are wider than the stroke of {self._stroke_mm} mm")
        if len(widths) < len(regions):
            parts.append(f"{len(regions) - len(widths)} have a lateral curvature of {self.curvature_floor:g} or less")
        return f"none of {len(regions)} regions can be held: " + ", and ".join(parts)

    def _regions(self, cloud: FloatArray, local: FloatArray) -> list[RegionReport]:
        """The slabs along the object's long axis and, where a slab falls apart, its clusters too."""
        regions = []
        for slab, members in enumerate(slabs(local[:, 1], self.gripper.finger_width)):
            if len(members) <= self.slab_points:
                continue
            regions.append(self._report(cloud[members], local[members], slab, None))
            labels = euclidean_clusters(local[members], self.cluster_tolerance)
            sizes = np.bincount(labels)
            fitting = np.flatnonzero((sizes >= self.cluster_points[0]) & (sizes <= self.cluster_points[1]))
            if len(sizes) == 1:
                continue  # the slab in one piece: its cluster is the slab
            for cluster in fitting:
                chosen = members[labels == cluster]
                regions.append(self._report(cloud[chosen], local[chosen], slab, int(cluster)))
        return regions

    def _report(self, points: FloatArray, local: FloatArray, slab: int, cluster: int | None) -> RegionReport:
        """Primitive, length L_i and lateral curvature P_i of a region, and the verdict on them."""
        count = len(points)
        tree = cKDTree(local)
        primitive = primitive_of(surface_variation(local, max(3, count // self.neighbour_divisor), tree))
        x = local[:, 0]
        sides = local[[int(x.argmax()), int(x.argmin())]]
        curvature = float(variation_at(local, sides, max(4, 2 * count // self.neighbour_divisor), tree).sum())
        width = float(np.ptp(x))
        if width > self.gripper.stroke:
            verdict = f"too wide: {width * 1e3:.0f} mm"
        elif curvature <= self.curvature_floor:
            verdict = f"lateral curvature at or below the floor of {self.curvature_floor:g}"
        else:
            verdict = "candidate"
        return RegionReport(points, primitive, width, curvature, verdict, slab, cluster)

    def _grasp(
        self,
        points: FloatArray,
        axes: FloatArray,
        scene: tuple[FloatArray | None, FloatArray | None],
        kind: str,
        region: int | None,
        terms: dict[str, float],
    ) -> Grasp:
        """The pose at the centre of the points: midway along the closing axis, the mean along the other two."""
        up, plane = scene
        rotation = _hand(points, axes, up)
        local = points @ rotation
        centre = local.mean(axis=0)
        low, high = float(local[:, 0].min()), float(local[:, 0].max())
        centre[0] = 0.5 * (low + high)
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = rotation @ centre
        if plane is not None:
            tips = pose[:3, 3] + 0.5 * self.gripper.pad_length * rotation[:, 2]
            missing = self.tip_clearance - float(plane[:3] @ tips + plane[3])
            pose[:3, 3] += max(0.0, missing) * plane[:3]
        # P is at most 2/3 (two neighbourhoods of σ = 1/3): 1 is flat on both sides, 0 has no flat side.
        score = 1.0 - 1.5 * terms.get("curvature", 0.0)
        return Grasp(pose, high - low, score, "primitive" if kind == "primitive" else "region", region, terms)


def _aligned(points: FloatArray, axes: FloatArray) -> FloatArray:
    """PCA of a region, its axes named after the object's: right-handed (3, 3), columns nearest to x, y, z of `axes`."""
    own = principal_axes(points)
    likeness = np.abs(axes.T @ own)
    y = int(likeness[1].argmax())
    x = max((i for i in range(3) if i != y), key=lambda i: likeness[0, i])
    long = own[:, y] * np.where(own[:, y] @ axes[:, 1] < 0, -1.0, 1.0)
    across = own[:, x] * np.where(own[:, x] @ axes[:, 0] < 0, -1.0, 1.0)
    return np.column_stack([across, long, np.cross(across, long)])


def _hand(points: FloatArray, axes: FloatArray, up: FloatArray | None) -> FloatArray:
    """Grasp frame (3, 3) from the region's axes: see the class for the two rules."""
    if up is None:
        approach, closing = way_in(points, axes[:, 2]), axes[:, 0]
    else:
        approach = -up
        upright = np.abs(up @ axes)
        closing = axes[:, 0] if upright[0] <= max(upright[2], 0.7) else axes[:, 2]
        closing = closing - (closing @ approach) * approach
        closing /= np.linalg.norm(closing)
    return np.column_stack([closing, np.cross(approach, closing), approach])
