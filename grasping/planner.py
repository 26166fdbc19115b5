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
- Of the holds at one place, which hardly differ, the middle is taken (`plateaus`), so that noise hardly moves it.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.clouds import object_cloud, require_near, workspace
from grasping.contacts import Contacts, refine
from grasping.errors import require_between
from grasping.grasp import Grasp, GraspPlan, plan_from
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.plateaus import SAG, Tried, places, to_either_side
from grasping.profiles import Holds, scan
from grasping.published import PublishedPlanner
from grasping.scoring import best_unlike, centre_term, clip, overlap_term, weigh
from grasping.survey import Survey, survey
from grasping.views import View, views_from_above, views_without_table

FloatArray = NDArray[np.float64]
Terms = dict[str, FloatArray]

LEAST_OVERLAP = 0.004  # m
PARALLEL = math.radians(5)  # a contact turned by less than this against the pad is as good as parallel
LEAST_CONTACT = 0.3  # share of a pad's width
MOST_CLEARANCE = 0.015  # m beside each pad on the way in, where there is room
DEPTH_STEP, MOST_DEPTHS = 0.015, 5  # depths of the tips that are tried
SLID, CENTRED, CANDIDATES = 3, 4, 8  # best places that are looked at on either side, in the middle, at all


class CurvaturePlanner:
    """Plan grasps for a two-finger gripper on the cloud of one object.

    side_clearance: free space between an open pad and the object on the way in, m.
    tip_clearance: the tips stay this far above a known table, m.
    stroke_margin: the opening at contact stays this far below the stroke, m.
    friction: coefficient between pad and object; contacts outside its cone slip.
    headings: number of closing directions that the scan tries over half a turn; each hold found is then turned freely.
    max_tilt: of the approach against straight down, rad, where straight down finds nothing; 0 never tilts.
    n_points: larger clouds are thinned, to boxes of 2.5 mm and, along the approach, 10 mm.

    Terms of a grasp: those of the score (`scoring.WEIGHTS`) and, for the policy, `opening`: to come in with, m;
    `tip_height`: of the tips above the table, or above the lowest point seen, m; `tilt`: of the approach, rad.
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
            require_between(name, value, least, most)
        self.gripper = gripper
        self.side_clearance = side_clearance
        self.tip_clearance = tip_clearance
        self.stroke_margin = stroke_margin
        self.friction = friction
        self.headings = headings
        self.max_tilt = max_tilt
        self.n_points = n_points

    @staticmethod
    def published(gripper: Gripper = ROBOTIQ_2F_140, **left_open: Any) -> PublishedPlanner:
        """The planner of the dissertation's chapter 5. `PublishedPlanner` names what its text leaves open."""
        return PublishedPlanner(gripper, **left_open)

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
        cloud = np.asfortranarray(object_cloud(points))  # sums and extremes over long rows are fast
        up_vector, plane, neighbours = workspace(up, table, obstacles)
        if plane is not None:
            require_near(cloud, plane)
        if up_vector is None:
            views = views_without_table(cloud, neighbours, self.n_points)
        else:
            views = views_from_above(cloud, up_vector, plane, neighbours, self.n_points, self.max_tilt)
        seen: Survey | None = None
        failures: list[str] = []
        for view in views:
            held, holds, reason = self._plan_view(view)
            if seen is None:
                seen = survey(view, holds, self.gripper.finger_width, self._greatest_width)
            if held is not None:
                return plan_from(self._grasps(view, held, seen), seen.regions, "")
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

    def _plan_view(self, view: View) -> tuple[Tried | None, Holds | None, str]:
        """What holds along one approach; the coarse holds; why there is none."""
        top = float(view.height.max())
        lowest = max(view.floor + self.tip_clearance, top - self._reach)
        deepest_top = top - LEAST_OVERLAP
        if deepest_top <= lowest:
            high, clear = (top - view.floor) * 1e3, self.tip_clearance * 1e3
            return None, None, f"the object is only {high:.0f} mm high; the tips stay {clear:.0f} mm above the table"
        step = max(DEPTH_STEP, (deepest_top - lowest) / MOST_DEPTHS)
        count = min(MOST_DEPTHS, math.ceil((deepest_top - lowest) / step))
        tips = lowest + step * np.arange(count, dtype=np.float64)
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
                return None, holds, f"the object is at least {wide:.0f} mm wide; the gripper takes {most:.0f} mm"
            return None, holds, "no room for the fingers: something stands beside the object on every line across it"
        chosen = holds.take(best_unlike(holds, self._coarse_score(holds, view)))
        tried = self._try(view, chosen, chosen.whole.astype(np.float64))
        if np.isfinite(tried.score).any():
            return self._best_places(view, tried), holds, ""
        refused = Counter(self._problems(tried.contacts))
        reason = f"none of the {len(chosen)} best places holds: "
        reason += "; ".join(f"{why} ({n})" for why, n in sorted(refused.items()))
        if found.too_wide:
            wide, most = found.narrowest * 1e3, self._greatest_width * 1e3
            reason += f"; elsewhere the object is at least {wide:.0f} mm wide and the gripper takes {most:.0f} mm"
        return None, holds, reason

    def _try(self, view: View, holds: Holds, whole: FloatArray) -> Tried:
        """Look closely at holds, of which `whole` (M,) is the share of their slabs that is between the pads."""
        contacts = refine(
            view.xy,
            view.height,
            view.obstacle_xy,
            view.obstacle_height,
            holds,
            pad_width=self.gripper.finger_width,
            wished_room=self._wished_room,
        )
        refused = np.any(list(self._checks(contacts).values()), axis=0)
        return Tried(contacts, whole, np.where(refused, -np.inf, weigh(self._terms(contacts, view, whole))))

    def _best_places(self, view: View, tried: Tried) -> Tried:
        """The middle of each of the best places, or the best hold there if that is better, of the others that one."""
        beside = to_either_side(places(tried, SLID))
        tried = tried.and_also(self._try(view, beside.holds, beside.whole))
        there = places(tried, CANDIDATES)
        best = tried.take(there.best)
        first = np.arange(min(CENTRED, len(there.best)))
        middles = self._try(view, there.holds.take(first), there.whole[first])
        centred = np.flatnonzero(middles.score >= best.score[first] - SAG)
        return middles.take(centred).and_also(best.take(np.setdiff1d(np.arange(len(there.best)), centred)))

    def _checks(self, contacts: Contacts) -> dict[str, NDArray[np.bool_]]:
        """What speaks against a hold, and of which of the holds it is true."""
        return {
            "too few points between the pads": contacts.empty,
            "too wide": contacts.width > self._greatest_width,
            "no room for the fingers": contacts.gap < self._finger_room,
            "the pads would touch a slope": contacts.overlap < LEAST_OVERLAP,
            "the contacts slip": contacts.angle > math.atan(self.friction),
            "the pads would touch a corner": contacts.contact < LEAST_CONTACT,
        }

    def _problems(self, contacts: Contacts) -> list[str]:
        """The first thing that speaks against each of the holds, none of which holds."""
        checks = self._checks(contacts)
        first = np.array(list(checks.values())).argmax(axis=0)
        return [list(checks)[index] for index in first.tolist()]

    def _coarse_score(self, holds: Holds, view: View) -> FloatArray:
        # The scan's resolution blurs angles by about 0.15 rad, so here a slope only costs and does not exclude.
        score = weigh(
            {
                "angle": clip(1.0 - holds.angle / (math.atan(self.friction) + 0.15)),
                "overlap": overlap_term(holds.overlap),
                "centre": centre_term(holds.x, holds.y, view.centre),
                "room": holds.room,
                "narrow": 1.0 - holds.width / self.gripper.stroke,
                "whole": holds.whole.astype(np.float64),
            }
        )
        return np.where(holds.overlap >= LEAST_OVERLAP, score, score - 1.0)

    def _terms(self, contacts: Contacts, view: View, whole: FloatArray) -> Terms:
        """Terms of the score and measures for the policy, as in the class's docstring; each (M,)."""
        limit = math.atan(self.friction)
        spare = (contacts.gap - self._finger_room) / (self._wished_room - self._finger_room)
        clear = np.minimum(np.maximum(contacts.gap - self.gripper.finger_thickness, 0.0), MOST_CLEARANCE)
        return {
            "contact": contacts.contact,
            "angle": clip((limit - contacts.angle) / (limit - min(PARALLEL, 0.5 * limit))),
            "overlap": overlap_term(contacts.overlap),
            "centre": centre_term(contacts.x, contacts.y, view.centre),
            "room": clip(spare),
            "narrow": clip(1.0 - contacts.width / self.gripper.stroke),
            "whole": whole,
            "opening": np.minimum(self.gripper.stroke, contacts.width + 2.0 * clear),
            "tip_height": contacts.tip - view.floor,
            "tilt": np.full(len(contacts.x), view.tilt),
        }

    def _grasps(self, view: View, held: Tried, seen: Survey) -> list[Grasp]:
        contacts, terms = held.contacts, self._terms(held.contacts, view, held.whole)
        x, y, tip, heading = contacts.x, contacts.y, contacts.tip, contacts.heading
        closing = np.column_stack([np.cos(heading), np.sin(heading), np.zeros(len(x))]) @ view.axes.T
        across = np.column_stack([np.sin(heading), -np.cos(heading), np.zeros(len(x))]) @ view.axes.T
        poses = np.tile(np.eye(4), (len(x), 1, 1))
        poses[:, :3, 0], poses[:, :3, 1], poses[:, :3, 2] = closing, across, -view.axes[:, 2]
        tips = view.origin + np.column_stack([x, y, tip]) @ view.axes.T
        poses[:, :3, 3] = tips + 0.5 * self.gripper.pad_length * view.axes[:, 2]
        central = np.hypot(x - view.centre[0], y - view.centre[1]) < 0.5 * self.gripper.finger_width
        if not seen.one_primitive():
            central[:] = False
        regions = seen.regions_at(tips)
        widths, scores = contacts.width.tolist(), held.score.tolist()
        named = [dict(zip(terms, row, strict=True)) for row in np.array(list(terms.values())).T.tolist()]
        return [
            Grasp(pose, width, score, "primitive", None, own)
            if primitive
            else Grasp(pose, width, score, "region", region, own)
            for pose, width, score, primitive, region, own in zip(
                poses, widths, scores, central.tolist(), regions, named, strict=True
            )
        ]
