"""The planner for a real arm: one depth camera's view of an object on a table → grasps that the arm can take.

It keeps the dissertation's order of ideas (axes, slabs and their parts, primitives, lateral curvature: `published.py`)
and departs from it where a one-sided cloud and a real hand ask for it:

- The approach is straight down on the table, or tilted where nothing else is left; without a table it is along the
  cloud's own axes, from the camera's side.
- Slabs lie across every heading of the gripper, not only across the long axis, and overlap (`finger_scan.scan`).
- What the camera cannot see below a seen surface counts as the object, down to the table. Where it is known where the
  camera stood, the back of an object seen from a side is assumed (`unseen_back`), and a finger's way that was not seen
  costs (`line_of_sight`).
- Each pad must touch something with an area, not stray points.
- Lateral curvature is measured on the contour under the pad (`contact_refinement.refine`), at one length, that of the
  pad; σ of a number of neighbours depends on the density of the cloud and on the view.
- Fingers must come down beside the object, clear of the table and of the neighbours, and the palm clear of what hangs
  over it.
- Of the candidates at one place, which hardly differ, the middle is taken (`grasp_clusters`): noise hardly moves it.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.curvature_planner.approach_view import ApproachView
from grasping.curvature_planner.approaches import approaches_from_above, approaches_without_table
from grasping.curvature_planner.backend import Backend
from grasping.curvature_planner.compiled_backend import AVAILABLE, CompiledBackend
from grasping.curvature_planner.contact_refinement import CONTACT_BAND, LEAST_WIDTH, fewest_near_a_pad
from grasping.curvature_planner.finger_scan import Candidates
from grasping.curvature_planner.line_of_sight import sight_of
from grasping.curvature_planner.numpy_backend import NumpyBackend
from grasping.curvature_planner.ranking import LEAST_OVERLAP, Ranked, Rules
from grasping.curvature_planner.region_report import ObjectReport, report_regions
from grasping.curvature_planner.scoring import leverage
from grasping.errors import ConfigError, require_between
from grasping.geometry.level_frame import GraspScores, level_scores
from grasping.grasp import Grasp, GraspPlan, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.validation import object_rows, require_near, sight, workspace

if TYPE_CHECKING:
    from grasping.baselines.published.planner import PublishedPlanner

FloatArray = NDArray[np.float64]

PALM_CLEARANCE = 0.01  # m above whatever is under the palm
# At what is low the tips go nearer to the table, in proportion: 4 mm above it they pass over the widest part of an 8 mm
# rod. Shares of the height above which half of the surface lies: an allen key is low although its short leg stands up.
TIP_SHARE, OVERLAP_SHARE = 0.2, 0.5
LEAST_TIP_CLEARANCE = 0.001  # m; a fitted table is off by a tenth of that in simulation
DEPTH_STEP, MOST_DEPTHS = 0.015, 5  # depths of the tips that are tried


class CurvaturePlanner:
    """Plan grasps for a two-finger gripper on the cloud of one object.

    side_clearance: free space between an open pad and the object on the way in, m.
    tip_clearance: the tips stay this far above a known table, m; at what is lower than 20 mm a fifth of its height, but
        no less than 1 mm. The hand must keep them there while it closes (`Gripper.pad_depth`).
    stroke_margin: the opening at contact stays this far below the stroke, m.
    friction: coefficient between pad and object; contacts outside its cone slip.
    headings: number of closing directions that the scan tries over half a turn; candidates are then turned freely.
    max_tilt: of the approach against straight down, rad, where straight down finds nothing; 0 never tilts.
    min_tilt: with more than 0 the grasps are those of all approaches over a table that are tilted at least so far, rad:
        for an arm that can carry out none of those straight down.
    n_points: larger clouds are thinned, to boxes of 2.5 mm and, along the approach, 10 mm.
    compiled: whether to plan with the compiled kernels or with their NumPy reference, which finds the same more slowly;
        None takes the kernels where this installation has them (`grasping.compiled`).
    rerank: what scores and orders the candidates anew, such as `pec.grasps.GraspScorer`, a trained network; the score
        that they had is then their term `geometry`. None: they keep it.

    Terms of a grasp: those of the score (`scoring.WEIGHTS`), among them `seen`: the share of the fingers' way beside
    the object that was seen, the worse side, 1 where no viewpoint is known; and `assumed`: of the width what no
    measured point stands for but the assumed back of the object, m, which costs, too. For the policy, `opening`: to
    come in with, m; `tip_height`: of the tips above the table, or above the lowest point seen, m; `tilt`: of the
    approach, rad.
    """

    def __init__(
        self,
        gripper: Gripper = ROBOTIQ_2F_140,
        *,
        side_clearance: float = 0.005,
        tip_clearance: float = 0.004,
        stroke_margin: float = 0.010,
        friction: float = 0.4,
        headings: int = 12,
        max_tilt: float = math.radians(35),
        min_tilt: float = 0.0,
        n_points: int = 4000,
        compiled: bool | None = None,
        rerank: GraspScores | None = None,
    ) -> None:
        for name, value, least, most in (
            ("side_clearance", side_clearance, 0.0, gripper.stroke / 2),
            ("tip_clearance", tip_clearance, 0.0, 0.1),
            ("stroke_margin", stroke_margin, 0.0, 0.9 * gripper.stroke),
            ("friction", friction, 0.05, 5.0),
            ("headings", headings, 2, 180),
            ("max_tilt", max_tilt, 0.0, 1.2),
            ("min_tilt", min_tilt, 0.0, max_tilt),
            ("n_points", n_points, 50, 10**7),
            ("gripper.finger_width", gripper.finger_width, 0.001, 1.0),  # the scan's lines are a third of it
        ):
            require_between(name, value, least, most)
        self.gripper = gripper
        self.side_clearance = side_clearance
        self.tip_clearance = tip_clearance
        self.stroke_margin = stroke_margin
        self.friction = friction
        self.headings = headings
        self.max_tilt = max_tilt
        self.min_tilt = min_tilt
        self.n_points = n_points
        self.rerank = rerank
        if compiled and not AVAILABLE:
            raise ConfigError("compiled = True, but this installation has no compiled kernels")
        if self._reach <= LEAST_OVERLAP:
            raise ConfigError(
                f"gripper.palm_depth = {gripper.palm_depth!r}: at the greatest opening the tips are not even "
                f"{(LEAST_OVERLAP + PALM_CLEARANCE) * 1e3:.0f} mm in front of the palm"
            )
        self._backend: Backend = CompiledBackend() if AVAILABLE and compiled is not False else NumpyBackend()
        self._headings = np.linspace(0.0, np.pi, headings, endpoint=False)
        finger_room = side_clearance + gripper.finger_thickness
        self._rules = Rules(
            pad_width=gripper.finger_width,
            stroke=gripper.stroke,
            finger_thickness=gripper.finger_thickness,
            finger_room=finger_room,
            wished_room=finger_room + 0.015,
            greatest_width=gripper.stroke - stroke_margin,
            reach=self._reach,
            friction=friction,
        )
        # From above an object may be too flat to show how steep its sides are. A tilted hand must see it: the edge of a
        # box, seen so, is a ridge between two slopes; what is filled in down to the table is as thin as what was seen.
        overlap = max(self._rules.least_overlap, CONTACT_BAND / friction)
        self._rules_tilted = replace(self._rules, least_overlap=overlap, least_reach=LEAST_WIDTH)

    @staticmethod
    def published(gripper: Gripper = ROBOTIQ_2F_140, **left_open: Any) -> PublishedPlanner:
        """The planner of the dissertation's chapter 5. `PublishedPlanner` names what its text leaves open."""
        from grasping.baselines.published.planner import (
            PublishedPlanner,  # loads SciPy, which this planner does without
        )

        return PublishedPlanner(gripper, **left_open)

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
        """Plan on the cloud (N, 3) of one object, m, in any frame.

        up: (3,) away from the table. table: plane (4,), n·p + d = 0. obstacles: (K, 3) points of other things.
        viewpoint: (3,) where the camera stood, or (V, 3) the cameras of a merged cloud; None: the origin, where
        `line_of_sight.sight_of` finds that a camera can have seen the cloud from there. unseen: (U, 3) far ends of
        lines of sight from the viewpoint, of several the last, on which nothing was measured. All in the cloud's frame.
        Regions hold the assumed back, too. Raises CloudError for a cloud, ConfigError for a scene that is none.
        """
        cloud = object_rows(points)
        up_vector, plane, neighbours = workspace(up, table, obstacles)
        viewpoints, rays = sight(viewpoint, unseen)
        if plane is not None:
            require_near(cloud, plane)
        seen = sight_of(cloud, neighbours, viewpoints, rays, up_vector, plane, self._backend.look)
        if up_vector is None:
            views = approaches_without_table(cloud, neighbours, self.n_points, self._backend, seen)
        else:
            views = approaches_from_above(
                cloud, up_vector, plane, neighbours, self.n_points, self.max_tilt, self._backend, seen
            )
        report: ObjectReport | None = None
        failures: list[str] = []
        grasps: list[Grasp] = []
        least = 0.0 if up_vector is None else self.min_tilt
        for view in views:
            ranked, candidates, reason = self._plan_view(view)
            if report is None:
                measures = self._backend.measure_regions(view, candidates, self.gripper.finger_width)
                report = report_regions(view, measures, self._rules.greatest_width)
            if ranked is None:
                failures.append(reason)
            elif view.tilt >= least:
                grasps += self._grasps(view, ranked, report)
                if not least:
                    break
        if grasps and report is not None:
            if self.rerank is not None:
                grasps = _reranked(self.rerank, grasps, cloud.T, up_vector, plane)
            return plan_from(grasps, report.regions, "")
        return plan_from([], [] if report is None else report.regions, failures[0])

    @property
    def _reach(self) -> float:
        """From the tips to the palm at the greatest opening, where it is least, less the palm's clearance, m."""
        tips = self.gripper.pad_depth(self.gripper.stroke) + 0.5 * self.gripper.pad_length
        return tips - self.gripper.palm_depth - PALM_CLEARANCE

    def _plan_view(self, view: ApproachView) -> tuple[Ranked | None, Candidates | None, str]:
        """What holds along one approach; the coarse candidates; why there is none."""
        top = float(view.points[2, -1])
        typical = float(view.points[2, view.points.shape[1] // 2]) - view.floor
        clearance = min(self.tip_clearance, max(LEAST_TIP_CLEARANCE, TIP_SHARE * typical))
        rules = self._rules_tilted if view.tilt else self._rules
        if not view.tilt:
            rules = _for_object(view, rules, OVERLAP_SHARE * typical)
        fewest = fewest_near_a_pad(view.points, rules.pad_width)
        if fewest != rules.least_points:
            rules = replace(rules, least_points=fewest)
        lowest = max(view.floor + clearance, top - self._reach)
        deepest_top = top - rules.least_overlap
        if deepest_top <= lowest:
            high, clear = (top - view.floor) * 1e3, clearance * 1e3
            return None, None, f"the object is only {high:.0f} mm high; the tips stay {clear:.0f} mm above the table"
        step = max(DEPTH_STEP, (deepest_top - lowest) / MOST_DEPTHS)
        count = min(MOST_DEPTHS, math.ceil((deepest_top - lowest) / step))
        found = self._backend.scan(
            view.points,
            view.obstacles,
            tips=lowest + step * np.arange(count, dtype=np.float64),
            headings=self._headings,
            pad_width=rules.pad_width,
            finger_room=rules.finger_room,
            wished_room=rules.wished_room,
            greatest_width=rules.greatest_width,
            reach=rules.reach,
            centre=view.centre,
        )
        candidates: Candidates = found.candidates
        wide, most = found.narrowest * 1e3, rules.greatest_width * 1e3
        if not len(candidates):
            if found.too_wide:
                return None, candidates, f"the object is at least {wide:.0f} mm wide; the gripper takes {most:.0f} mm"
            where = "something stands beside the object, or hangs over it, on every line across it"
            return None, candidates, f"no room for the fingers: {where}"
        ranked: Ranked = self._backend.rank(view, candidates, rules)
        if not ranked.problems:
            return ranked, candidates, ""
        refused = Counter(ranked.problems)
        reason = f"none of the {len(ranked.problems)} best places holds: "
        reason += "; ".join(f"{why} ({n})" for why, n in sorted(refused.items()))
        if found.too_wide:
            reason += f"; elsewhere the object is at least {wide:.0f} mm wide and the gripper takes {most:.0f} mm"
        return None, candidates, reason

    def _grasps(self, view: ApproachView, ranked: Ranked, report: ObjectReport) -> list[Grasp]:
        contacts = ranked.contacts
        x, y, tip = contacts.x, contacts.y, contacts.tip
        count, cos, sin = len(x), np.cos(contacts.heading), np.sin(contacts.heading)
        # Seen along the approach, a row each: the closing axis, the axis across it, the approach, the tips.
        local = np.zeros((count, 4, 3))
        local[:, 0, 0], local[:, 0, 1], local[:, 1, 0], local[:, 1, 1] = cos, sin, sin, -cos
        local[:, 2, 2] = -1.0
        local[:, 3, 0], local[:, 3, 1], local[:, 3, 2] = x, y, tip
        poses = np.zeros((count, 4, 4))
        poses[:, :3] = (local @ view.axes.T).transpose(0, 2, 1)
        tips = poses[:, :3, 3] + view.origin
        poses[:, :3, 3] = tips + 0.5 * self.gripper.pad_length * view.axes[:, 2]
        poses[:, 3, 3] = 1.0
        names = (*ranked.terms, "tip_height", "tilt")
        columns = (*(term.tolist() for term in ranked.terms.values()), (tip - view.floor).tolist(), [view.tilt] * count)
        rows = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
        whole = [False] * count  # held at the centre of an object that is one primitive
        if report.one_primitive():
            whole = (np.hypot(x - view.centre[0], y - view.centre[1]) < 0.5 * self.gripper.finger_width).tolist()
        found = (poses, contacts.width.tolist(), ranked.score.tolist(), whole, report.regions_at(tips), rows)
        return [
            Grasp(pose, width, score, "primitive" if all_of_it else "region", None if all_of_it else region, terms)
            for pose, width, score, all_of_it, region, terms in zip(*found, strict=True)
        ]


def _reranked(
    scores: GraspScores, grasps: list[Grasp], cloud: FloatArray, up: FloatArray | None, table: FloatArray | None
) -> list[Grasp]:
    poses, widths = np.array([grasp.pose for grasp in grasps]), np.array([grasp.width for grasp in grasps])
    said = level_scores(scores, cloud, poses, widths, up, table).tolist()
    return [
        replace(grasp, score=score, terms={**grasp.terms, "geometry": grasp.score})
        for grasp, score in zip(grasps, said, strict=True)
    ]


def _for_object(view: ApproachView, rules: Rules, overlap: float) -> Rules:
    """The rules for what is low, where an overlap (m) less than usual must do, and for what is long and heavy."""
    far, weight = leverage(view.farthest, view.volume)
    overlap = min(rules.least_overlap, overlap)
    if (overlap, far, weight) == (rules.least_overlap, rules.far_from_centre, rules.weight_of_centre):
        return rules
    return replace(rules, least_overlap=overlap, far_from_centre=far, weight_of_centre=weight)
