"""The lateral-curvature planner exactly as the dissertation's chapter 5 specifies it.

What its text leaves open is a named parameter here. The defaults are the reading under which the claims of its figures
come true most often on this project's catalogue (docs/published_figures.md); `PublishedPlanner.released()` has the
values of the author's public release. `CurvaturePlanner` is the planner for a real arm; this one is what it is measured
against.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.baselines.published.poses import GraspPoses, Parts, grasp_poses, own_axes
from grasping.baselines.published.regions import RegionRules, regions_of
from grasping.errors import ConfigError
from grasping.geometry.primitives import all_alike
from grasping.geometry.principal_axes import object_axes
from grasping.geometry.sampling import spread, thinned
from grasping.geometry.slabs import Rest
from grasping.grasp import Grasp, GraspPlan, RegionReport, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.validation import object_cloud, sight, workspace

FloatArray = NDArray[np.float64]


_RELEASED: dict[str, Any] = {
    "thinning": "every",
    "rest": "last slab",
    "neighbour_divisors": (6, 3),
    "curvature_floor": 0.016,
}


class PublishedPlanner:
    """PCA → slabs and their clusters → primitives → smallest sum of lateral curvatures (chapter 5).

    gripper: W_g is its stroke, H_g its finger width. An object no longer than H_g is held at its centre.

    Values that the text leaves open. The defaults make the eight figures' claims true for 64 % of 50 catalogue
    instances each that are seen whole and for 42 % that are seen from one side; the values of the public release for
    18 and 40 %.

    n_points: the cloud is thinned to this many points, as the thresholds depend on density (256, inferred).
    thinning: "even", by farthest-point sampling, which makes neighbourhoods of one region alike; or "every" k-th point
        in the order of the long axis.
    rest: K = H_o / H_g is seldom whole. The slabs lie in the middle, and what is left at "both ends" is in none; or
        they run from y_max downward, and what is left at the "lower end" is in none or is the "last slab" (public
        release), which is less high, flatter and of another length than the others.
    slab_points: a slab needs more points than this (public release: 8).
    cluster_tolerance, cluster_points: Euclidean clusters in a slab, m, and their least and greatest number of points
        (public release: 0.02 or 0.03 m, 5 to 100). The whole slab stays a region beside them, as the text has it.
    neighbour_divisors, least_neighbours: n of the neighbourhoods for the primitive and for a lateral curvature, of
        k = N_region / n points, at least so many. They stay within their region, count the point itself and take in
        all points that are as near as the k-th. Public release: n = (6, 3), in a launch file (4, 2); 3 and 4 points.
    similar_length: regions whose lengths differ by no more are alike, m (public release: 8 mm).
    alike: which regions must be alike for the object to be one primitive: "consecutive" ones of those sorted by P
        (public release), so that the length may drift along them, or "all".
    curvature_floor: a region with P at or below it is not taken. The text has none, which is 0. Public release: 0.016,
        against almost empty neighbourhoods.
    tip_clearance: the pads' tips are kept this far above a known table, m. Not in the text; without a table no effect.

    The text has no rule for the approach. Here the closing axis is the region's own axis nearest to the object's x, the
    approach its z, from the seen side. Where `up` is given the approach is straight down instead, and the closing axis
    the most horizontal of the region's x and z. A primitive and a small object are held at their centroid, a region
    midway between its two sides. Nothing is held that is wider than the stroke, across its own axes too.

    Terms of a grasp on a region: `curvature`, P, and `length`, L, m. Score: 1 - 1.5 P; P is at most 2/3.
    """

    def __init__(
        self,
        gripper: Gripper = ROBOTIQ_2F_140,
        *,
        n_points: int = 256,
        thinning: Literal["even", "every"] = "even",
        rest: Rest = "both ends",
        slab_points: int = 8,
        cluster_tolerance: float = 0.02,
        cluster_points: tuple[int, int] = (5, 100),
        neighbour_divisors: tuple[int, int] = (4, 4),
        least_neighbours: tuple[int, int] = (3, 4),
        similar_length: float = 0.008,
        alike: Literal["consecutive", "all"] = "consecutive",
        curvature_floor: float = 0.0,
        tip_clearance: float = 0.004,
    ) -> None:
        for name, value, least in (
            ("n_points", n_points, 16),
            ("slab_points", slab_points, 0),
            ("cluster_tolerance", cluster_tolerance, 1e-6),
            ("similar_length", similar_length, 0.0),
            ("curvature_floor", curvature_floor, 0.0),
            ("tip_clearance", tip_clearance, 0.0),
        ):
            if not (math.isfinite(value) and value >= least):
                raise ConfigError(f"{name} = {value!r} must be at least {least}")
        if len(cluster_points) != 2 or not 1 <= cluster_points[0] <= cluster_points[1]:
            raise ConfigError(f"cluster_points = {cluster_points!r} must be (least, greatest), at least 1")
        if thinning not in ("even", "every"):
            raise ConfigError(f"thinning = {thinning!r} must be 'even' or 'every'")
        if rest not in get_args(Rest):
            raise ConfigError(f"rest = {rest!r} must be one of {', '.join(map(repr, get_args(Rest)))}")
        if len(neighbour_divisors) != 2 or min(neighbour_divisors) < 1:
            raise ConfigError(f"neighbour_divisors = {neighbour_divisors!r} must be (primitive, lateral), at least 1")
        if len(least_neighbours) != 2 or min(least_neighbours) < 3:
            raise ConfigError(f"least_neighbours = {least_neighbours!r} must be (primitive, lateral), at least 3")
        if alike not in ("consecutive", "all"):
            raise ConfigError(f"alike = {alike!r} must be 'consecutive' or 'all'")
        self.gripper = gripper
        self.n_points = n_points
        self.thinning = thinning
        self.rest = rest
        self.slab_points = slab_points
        self.cluster_tolerance = cluster_tolerance
        self.cluster_points = (cluster_points[0], cluster_points[1])
        self.neighbour_divisors = (neighbour_divisors[0], neighbour_divisors[1])
        self.least_neighbours = (least_neighbours[0], least_neighbours[1])
        self.similar_length = similar_length
        self.alike = alike
        self.curvature_floor = curvature_floor
        self.tip_clearance = tip_clearance
        self._rules = RegionRules(
            height=gripper.finger_width,
            rest=rest,
            slab_points=slab_points,
            cluster_tolerance=cluster_tolerance,
            cluster_points=self.cluster_points,
            neighbour_divisors=self.neighbour_divisors,
            least_neighbours=self.least_neighbours,
        )

    @staticmethod
    def released(gripper: Gripper = ROBOTIQ_2F_140, **changed: Any) -> PublishedPlanner:
        """With the values of the author's public release, but for those that are `changed`."""
        return PublishedPlanner(gripper, **{**_RELEASED, **changed})

    def plan(
        self,
        points: ArrayLike,
        *,
        up: ArrayLike | None = None,
        table: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
        unseen: ArrayLike | None = None,
    ) -> GraspPlan:
        """Plan on the cloud (N, 3) of one object, m. Obstacles are checked for sense but, as published, not avoided;
        what was not seen (viewpoint, unseen) counts as free.

        Raises CloudError and ConfigError for input that is none.
        """
        cloud = object_cloud(points)
        up_vector, plane, _ = workspace(up, table, obstacles)
        sight(viewpoint, unseen)
        cloud = (spread if self.thinning == "even" else thinned)(cloud, self.n_points)
        centroid = cloud.mean(axis=0)
        axes = object_axes(cloud)
        local = (cloud - centroid) @ axes
        if np.ptp(local[:, 1]) <= self.gripper.finger_width:
            grasp = self._of_the_whole(cloud, axes, up_vector, plane)
            wide = f"the object is small, but {grasp.width * 1e3:.0f} mm wide; the gripper opens {self._stroke_mm} mm"
            return plan_from([grasp] if grasp.width <= self.gripper.stroke else [], [], wide)

        regions = self._regions(cloud, local)
        if not regions:
            return plan_from([], [], f"no slab of the object has more than {self.slab_points} points")
        if self._one_primitive(regions):
            grasp = self._of_the_whole(cloud, axes, up_vector, plane)
            width = max(grasp.width, *(region.width for region in regions))
            name = regions[0].primitive
            reason = f"the object is one {name}, {width * 1e3:.0f} mm wide; the gripper opens {self._stroke_mm} mm"
            return plan_from([grasp] if width <= self.gripper.stroke else [], regions, reason)
        candidates = self._of_regions(regions, axes, up_vector, plane)
        return plan_from(candidates, regions, self._no_region(regions))

    def _one_primitive(self, regions: list[RegionReport]) -> bool:
        if self.alike == "all":
            widths = [region.width for region in regions]
            same = len({region.primitive for region in regions}) == 1
            return same and max(widths) - min(widths) <= self.similar_length
        ordered = sorted(regions, key=lambda region: region.curvature)
        primitives = [region.primitive for region in ordered]
        return all_alike(primitives, [region.width for region in ordered], self.similar_length)

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
        """The slabs along the object's long axis and their clusters, measured, and the verdict on each."""
        reports = []
        for region in regions_of(local, self._rules):
            verdict = self._verdict(region.length, region.curvature)
            measures = (region.primitive, region.length, region.curvature)
            reports.append(RegionReport(cloud[region.members], *measures, verdict, region.slab, region.cluster))
        return reports

    def _verdict(self, length: float, curvature: float) -> str:
        if length > self.gripper.stroke:
            return f"too wide: {length * 1e3:.0f} mm"
        if 0.0 < self.curvature_floor >= curvature:
            return f"lateral curvature at or below the floor of {self.curvature_floor:g}"
        return "candidate"

    def _of_the_whole(
        self, cloud: FloatArray, axes: FloatArray, up: FloatArray | None, plane: FloatArray | None
    ) -> Grasp:
        """Hold the object at its centroid."""
        found = self._clear_of(grasp_poses(Parts([cloud]), axes[None], up, midway=False), plane)
        return Grasp(found.poses[0], float(found.widths[0]), 1.0, "primitive", None, {})

    def _of_regions(
        self, regions: list[RegionReport], axes: FloatArray, up: FloatArray | None, plane: FloatArray | None
    ) -> list[Grasp]:
        """Hold each candidate; the verdict on those that are too wide across their own axes is replaced."""
        chosen = [index for index, region in enumerate(regions) if region.verdict == "candidate"]
        if not chosen:
            return []
        parts = Parts([regions[index].points for index in chosen])
        found = self._clear_of(grasp_poses(parts, own_axes(parts, axes), up, midway=True), plane)
        grasps = []
        for index, pose, width in zip(chosen, found.poses, found.widths.tolist(), strict=True):
            region = regions[index]
            if width > self.gripper.stroke:
                wide = f"too wide across its own axes: {width * 1e3:.0f} mm"
                regions[index] = replace(region, verdict=wide)
                continue
            # P is at most 2/3 (two neighbourhoods of σ = 1/3): 1 is flat on both sides, 0 has no flat side.
            # Rounded, so that regions that are all flat keep their order.
            score = round(1.0 - 1.5 * region.curvature, 9)
            terms = {"curvature": region.curvature, "length": region.width}
            grasps.append(Grasp(pose, width, score, "region", index, terms))
        return grasps

    def _clear_of(self, found: GraspPoses, plane: FloatArray | None) -> GraspPoses:
        """Raise the poses until the pads' tips are clear of the table."""
        if plane is not None:
            tips = found.poses[:, :3, 3] + 0.5 * self.gripper.pad_length * found.poses[:, :3, 2]
            missing = self.tip_clearance - (tips @ plane[:3] + plane[3])
            found.poses[:, :3, 3] += np.maximum(0.0, missing)[:, None] * plane[:3]
        return found
