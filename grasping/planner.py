"""The planner for a real arm: one depth camera's view of an object on a table → grasps that the arm can take.

It keeps the dissertation's order of ideas (axes, slabs and their parts, primitives, lateral curvature: `published.py`)
and departs from it where a one-sided cloud and a real hand ask for it:

- The approach is straight down on the table, or tilted where nothing else is left; without a table it is along the
  cloud's own axes.
- Slabs lie across every heading of the gripper, not only across the long axis, and overlap (`profiles.scan`).
- What the camera cannot see below a seen surface counts as the object, down to the table.
- Lateral curvature is measured on the contour under the pad (`contacts.refine`), at one length, that of the pad; σ of a
  number of neighbours depends on the density of the cloud and on the view.
- Fingers must come down beside the object, clear of the table and of the neighbours.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.clouds import object_cloud, workspace
from grasping.contacts import Contacts, refine
from grasping.errors import ConfigError
from grasping.grasp import Grasp, GraspPlan, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.profiles import Holds, scan
from grasping.published import PublishedPlanner
from grasping.survey import Survey, survey
from grasping.views import View, views_from_above, views_without_table

FloatArray = NDArray[np.float64]

# Weights of the terms, each in [0, 1]; a score is their weighted mean.
WEIGHTS = {
    "contact": 0.18,  # share of the pads' width that touches: one minus the contour's lateral curvature
    "angle": 0.17,  # how far within the friction cone the contacts are
    "overlap": 0.25,  # how deep the pads reach beside the surface that they touch
    "centre": 0.20,  # nearness to the centre of mass
    "room": 0.10,  # free space for the fingers beyond what they need
    "narrow": 0.05,  # across the narrow side
    "whole": 0.05,  # around all of the slab and not around a part of it
}
REFINED = 8  # holds of the coarse scan that are looked at closely
ALIKE_PLACE, ALIKE_HEADING = 0.012, math.radians(20)  # holds nearer than this are one
LEAST_OVERLAP = 0.004  # m
PARALLEL = math.radians(5)  # a contact turned by less than this against the pad is as good as parallel
LEAST_CONTACT = 0.3  # share of a pad's width
MOST_CLEARANCE = 0.015  # m beside each pad on the way in, where there is room
FAR_FROM_CENTRE = 0.10  # m at which the term "centre" is 0
DEPTH_STEP, MOST_DEPTHS = 0.015, 5  # depths of the tips that are tried


class CurvaturePlanner:
    """Plan grasps for a two-finger gripper on the cloud of one object.

    side_clearance: free space between an open pad and the object on the way in, m.
    tip_clearance: the tips stay this far above a known table, m.
    stroke_margin: the opening at contact stays this far below the stroke, m.
    friction: coefficient between pad and object; contacts outside its cone slip.
    headings: number of closing directions that the scan tries over half a turn; each hold found is then turned freely.
    max_tilt: of the approach against straight down, rad, where straight down finds nothing; 0 never tilts.
    n_points: larger clouds are thinned, to boxes of 2.5 mm and, along the approach, 10 mm.

    Terms of a grasp: those of the score (`WEIGHTS`) and, for the policy, `opening`: to come in with, m; `tip_height`:
    of the tips above the table, or above the lowest point seen, m; `tilt`: of the approach, rad.
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
        n_points: int = 4000,
    ) -> None:
        for name, value, least, most in (
            ("side_clearance", side_clearance, 0.0, gripper.stroke / 2),
            ("tip_clearance", tip_clearance, 0.0, 0.1),
            ("stroke_margin", stroke_margin, 0.0, 0.9 * gripper.stroke),
            ("friction", friction, 0.05, 5.0),
            ("headings", headings, 2, 180),
            ("max_tilt", max_tilt, 0.0, 1.2),
            ("n_points", n_points, 50, 10**7),
        ):
            if not (math.isfinite(value) and least <= value <= most):
                raise ConfigError(f"{name} = {value!r} must be between {least:g} and {most:g}")
        self.gripper = gripper
        self.side_clearance = side_clearance
        self.tip_clearance = tip_clearance
        self.stroke_margin = stroke_margin
        self.friction = friction
        self.headings = headings
        self.max_tilt = max_tilt
        self.n_points = n_points

    @staticmethod
    def published(gripper: Gripper = ROBOTIQ_2F_140) -> PublishedPlanner:
        """The planner of the dissertation's chapter 5, with its own parameters."""
        return PublishedPlanner(gripper)

    def plan(
        self,
        points: ArrayLike,
        *,
        up: ArrayLike | None = None,
        table: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
    ) -> GraspPlan:
        """Plan on the cloud (N, 3) of one object, m, in any frame.

        up: (3,) away from the table. table: plane (4,), n·p + d = 0. obstacles: (K, 3) points of other things.
        All in the cloud's frame. Raises CloudError for a cloud, ConfigError for a scene that is none.
        """
        cloud = object_cloud(points)
        up_vector, plane, neighbours = workspace(up, table, obstacles)
        if up_vector is None:
            views = views_without_table(cloud, neighbours, self.n_points)
        else:
            views = views_from_above(cloud, up_vector, plane, neighbours, self.n_points, self.max_tilt)
        seen: Survey | None = None
        failures: list[str] = []
        for view in views:
            kept, holds, reason = self._plan_view(view)
            if seen is None:
                seen = survey(view, holds, self.gripper.finger_width, self._greatest_width)
            if kept:
                return plan_from([self._grasp(view, one, seen) for one in kept], seen.regions, "")
            failures.append(reason)
        return plan_from([], [] if seen is None else seen.regions, failures[0])

    @property
    def _greatest_width(self) -> float:
        return self.gripper.stroke - self.stroke_margin

    @property
    def _finger_room(self) -> float:
        return self.side_clearance + self.gripper.finger_thickness

    @property
    def _wished_room(self) -> float:
        return self._finger_room + 0.015

    @property
    def _reach(self) -> float:
        """From the tips to the palm at the greatest opening, where it is least, less a margin of 10 mm, m."""
        return (
            self.gripper.pad_depth(self.gripper.stroke) + 0.5 * self.gripper.pad_length - self.gripper.palm_depth - 0.01
        )

    def _plan_view(self, view: View) -> tuple[list[_Kept], Holds | None, str]:
        """All grasps along one approach with the terms of their scores, the coarse holds, and why there is none."""
        top = float(view.height.max())
        lowest = max(view.floor + self.tip_clearance, top - self._reach)
        deepest_top = top - LEAST_OVERLAP
        if deepest_top <= lowest:
            high, clear = (top - view.floor) * 1e3, self.tip_clearance * 1e3
            return [], None, f"the object is only {high:.0f} mm high; the tips stay {clear:.0f} mm above the table"
        count = min(MOST_DEPTHS, 1 + math.floor((deepest_top - lowest) / DEPTH_STEP))
        tips = np.linspace(lowest, deepest_top, count, endpoint=False)
        found = scan(
            view.xy,
            view.height,
            view.obstacle_xy,
            view.obstacle_height,
            tips=tips,
            headings=np.linspace(0.0, np.pi, self.headings, endpoint=False),
            pad_width=self.gripper.finger_width,
            finger_room=self._finger_room,
            wished_room=self._wished_room,
            greatest_width=self._greatest_width,
            centre=view.centre,
        )
        holds = found.holds
        if not len(holds):
            if found.too_wide:
                wide, most = found.narrowest * 1e3, self._greatest_width * 1e3
                return [], holds, f"the object is at least {wide:.0f} mm wide; the gripper takes {most:.0f} mm"
            return [], holds, "no room for the fingers: something stands beside the object on every line across it"
        chosen = holds.take(np.array(self._select(holds, view)))
        contacts = refine(
            view.xy,
            view.height,
            view.obstacle_xy,
            view.obstacle_height,
            chosen,
            pad_width=self.gripper.finger_width,
            wished_room=self._wished_room,
        )
        terms = self._terms(contacts, view, chosen.whole)
        score = self._weigh(terms)
        problems = self._problems(contacts)
        kept = [
            _Kept(
                heading=float(contacts.heading[i]),
                x=float(contacts.x[i]),
                y=float(contacts.y[i]),
                tip=float(contacts.tip[i]),
                width=float(contacts.width[i]),
                score=float(score[i]),
                terms={name: float(value[i]) for name, value in terms.items()},
            )
            for i, problem in enumerate(problems)
            if not problem
        ]
        refused = Counter(problem for problem in problems if problem)
        reason = f"none of the {len(problems)} best places holds: "
        reason += "; ".join(f"{why} ({n})" for why, n in sorted(refused.items()))
        if found.too_wide:
            wide, most = found.narrowest * 1e3, self._greatest_width * 1e3
            reason += f"; elsewhere the object is at least {wide:.0f} mm wide and the gripper takes {most:.0f} mm"
        return kept, holds, reason

    def _problems(self, contacts: Contacts) -> list[str]:
        """Why each of the holds is none; empty for those that hold."""
        checks = {
            "too few points between the pads": contacts.empty,
            "too wide": contacts.width > self._greatest_width,
            "no room for the fingers": contacts.gap < self._finger_room,
            "the pads would touch a slope": contacts.overlap < LEAST_OVERLAP,
            "the contacts slip": contacts.angle > math.atan(self.friction),
            "the pads would touch a corner": contacts.contact < LEAST_CONTACT,
        }
        return [next((why for why, bad in checks.items() if bad[i]), "") for i in range(len(contacts.x))]

    def _select(self, holds: Holds, view: View) -> list[int]:
        """The best holds of the scan, each unlike those before it."""
        distance = np.hypot(holds.x - view.centre[0], holds.y - view.centre[1])
        # The scan's resolution blurs angles by about 0.15 rad, so here a slope only costs and does not exclude.
        score = self._weigh(
            {
                "angle": np.clip(1.0 - holds.angle / (math.atan(self.friction) + 0.15), 0.0, 1.0),
                "overlap": _overlap_term(holds.overlap),
                "centre": np.clip(1.0 - distance / FAR_FROM_CENTRE, 0.0, 1.0),
                "room": holds.room,
                "narrow": 1.0 - holds.width / self.gripper.stroke,
                "whole": holds.whole.astype(np.float64),
            }
        )
        score = np.where(holds.overlap >= LEAST_OVERLAP, score, score - 1.0)
        chosen: list[int] = []
        for _ in range(REFINED):
            best = int(score.argmax())
            if not np.isfinite(score[best]):
                break
            chosen.append(best)
            turn = np.abs(holds.heading - holds.heading[best])
            turn = np.minimum(turn, np.pi - turn)
            near = np.hypot(holds.x - holds.x[best], holds.y - holds.y[best]) < ALIKE_PLACE
            alike = near & (turn < ALIKE_HEADING) & (np.abs(holds.tip - holds.tip[best]) < 1.5 * DEPTH_STEP)
            score = np.where(alike, -np.inf, score)
        return chosen

    def _terms(self, contacts: Contacts, view: View, whole: NDArray[np.bool_]) -> dict[str, FloatArray]:
        """Terms of the score and measures for the policy, as in the class's docstring; each (M,)."""
        limit = math.atan(self.friction)
        distance = np.hypot(contacts.x - view.centre[0], contacts.y - view.centre[1])
        spare = (contacts.gap - self._finger_room) / (self._wished_room - self._finger_room)
        clear = np.clip(contacts.gap - self.gripper.finger_thickness, 0.0, MOST_CLEARANCE)
        return {
            "contact": contacts.contact,
            "angle": np.clip((limit - contacts.angle) / (limit - min(PARALLEL, 0.5 * limit)), 0.0, 1.0),
            "overlap": _overlap_term(contacts.overlap),
            "centre": np.clip(1.0 - distance / FAR_FROM_CENTRE, 0.0, 1.0),
            "room": np.clip(spare, 0.0, 1.0),
            "narrow": np.clip(1.0 - contacts.width / self.gripper.stroke, 0.0, 1.0),
            "whole": whole.astype(np.float64),
            "opening": np.minimum(self.gripper.stroke, contacts.width + 2.0 * clear),
            "tip_height": contacts.tip - view.floor,
            "tilt": np.full(len(contacts.x), view.tilt),
        }

    def _weigh(self, terms: dict[str, FloatArray]) -> FloatArray:
        """Weighted mean of those terms that have a weight."""
        weights = {name: WEIGHTS[name] for name in terms if name in WEIGHTS}
        return sum((weight * terms[name] for name, weight in weights.items()), np.zeros(())) / sum(weights.values())

    def _grasp(self, view: View, kept: _Kept, seen: Survey) -> Grasp:
        cos, sin = math.cos(kept.heading), math.sin(kept.heading)
        pose = np.eye(4)
        pose[:3, 0] = cos * view.axes[:, 0] + sin * view.axes[:, 1]
        pose[:3, 1] = sin * view.axes[:, 0] - cos * view.axes[:, 1]  # approach × closing
        pose[:3, 2] = -view.axes[:, 2]
        pose[:3, 3] = view.in_cloud(kept.x, kept.y, kept.tip + 0.5 * self.gripper.pad_length)
        distance = math.hypot(kept.x - view.centre[0], kept.y - view.centre[1])
        if distance < 0.5 * self.gripper.finger_width and seen.one_primitive():
            return Grasp(pose, kept.width, kept.score, "primitive", None, kept.terms)
        region = seen.region_at(view.in_cloud(kept.x, kept.y, kept.tip))
        return Grasp(pose, kept.width, kept.score, "region", region, kept.terms)


@dataclass(frozen=True)
class _Kept:
    """One hold that passed every check, in its view's frame."""

    heading: float
    x: float
    y: float
    tip: float
    width: float
    score: float
    terms: dict[str, float]


def _overlap_term(overlap: FloatArray) -> FloatArray:
    """1 from 45 mm of pad beside the surface; most of it is earned with the first 15 mm."""
    return 0.7 * np.clip(overlap / 0.015, 0.0, 1.0) + 0.3 * np.clip(overlap / 0.045, 0.0, 1.0)
