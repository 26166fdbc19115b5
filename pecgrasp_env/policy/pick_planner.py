"""From depth frames to a planned pick: look, choose the object of the asked-for class, plan grasp and motion."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from grasping import CurvaturePlanner, GraspPlan, GraspPlanner, ModelPlanner, Segmenter
from grasping.pose.model_planner import told_class
from grasping.selective import CERTAIN, POSSIBLE, SURE
from pecgrasp_env.motion.grasp_approach import grasp_to_carry_out, plan_approach
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.policy.crowd import floor_below, lying_on, stands_over, uppermost_on, without_rim
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.observation import RobotObservation
from pecgrasp_env.policy.perception import View, look, still_there
from pecgrasp_env.policy.planned_pick import PlannedPick
from pecgrasp_env.policy.seen_objects import SeenObject, class_probabilities, is_near, log_odds, merge, most_trusted
from pecgrasp_env.robot.kinematics import UP

NOT_FOUND = "not found"

_DOUBT = 0.3  # of a second object, from which one look is not enough
_PUSHED_M = (0.0, 0.008, 0.015)  # by which a finger may push things aside, the more the fewer free ways there are
_HOLDS = (
    0.5  # of the term "bite", from which on nine of ten hold; for what is held by less, neighbours are pushed aside
)
_VIEWS_TO_CLEAR = 3  # of an object, after which what lies on it was seen
_AGREEING = 2  # views that show one thing, of which each alone is unsure
_BEYOND_DOUBT = 0.99  # probability of the class by both witnesses, from which two views that agree are enough
_UNKNOWN_BELOW = 0.5  # of a classifier that says how well it knows a thing and has no threshold for it
_WHOLE = 0.7  # certainty times `known`, from which nobody asks whether it is several
_CUTTING = (-1.5, -3.0)  # `whole_rather` of a `Segmenter`, by which what cannot be trusted is cut, and once more
_HIDDEN = 0.3  # of an object's outline, from which on it is looked at again


class PickPlanner:
    """Decides what to pick up and how; nothing moves.

    Args:
        classifier, planner, segmenter, min_confidence, clear: as `ScriptedPolicy` takes them.
        target: the class that is asked for.
        log: takes the stages' times and what was seen, chosen and planned.
    """

    def __init__(
        self,
        classifier: Any,
        planner: Any,
        segmenter: Segmenter,
        min_confidence: float,
        target: str,
        log: PolicyLog,
        clear: bool = False,
    ) -> None:
        self._classifier = classifier
        self._planner = planner
        self._segmenter = segmenter
        self._min_confidence = min_confidence
        self._clear = clear
        self._target = target
        self._log = log

    def look(self, observation: RobotObservation, known: list[SeenObject]) -> tuple[list[SeenObject], View]:
        """The objects of one depth frame, classified and joined with those known, and what else the frame shows.

        What the segmenter may have taken for one, or the classifier for none of its classes, is cut more finely. Pieces
        and pairs of them count where they can be trusted more than the whole: in a heap no one cut is right for all
        that lies there, and what two things in one or half of one look like, the classifier does not know.
        """
        _ = observation.frame  # a simulated camera renders it only now, and that is not part of segmenting
        view = self._classified(look, observation, self._segmenter)
        seen, pixels = view.objects, view.pixels
        candidates, of_candidates = list(seen), list(pixels)
        for whole_rather in _CUTTING if isinstance(self._segmenter, Segmenter) else ():
            if all(each.certainty * each.known >= _WHOLE for each in seen if each.evidence):
                break
            cutting = copy(self._segmenter)
            cutting.whole_rather = whole_rather
            finer = self._classified(_with_pairs, observation, cutting)
            candidates += finer.objects
            of_candidates += finer.pixels
            kept = most_trusted(candidates, of_candidates)
            seen, pixels = [candidates[k] for k in kept], [of_candidates[k] for k in kept]
        objects = merge(known, seen)
        self._log.views += 1
        self._log.objects = objects
        return objects, _with_rest(view, pixels)

    def _classified(
        self, see: Callable[[RobotObservation, Segmenter], View], observation: RobotObservation, segmenter: Segmenter
    ) -> View:
        with self._log.timed("segment"):
            view = see(observation, segmenter)
        with self._log.timed("classify"):
            if self._classifier is None:
                answers = [{self._target: 1.0} for _ in view.clouds]
            else:
                answers = class_probabilities(self._classifier, view.clouds)
            for seen, answer in zip(view.objects, answers, strict=True):
                seen.evidence += [answer] if answer else []
        return view

    def likeliest(self, objects: list[SeenObject]) -> int | None:
        """The object that is likeliest one whole object of the asked-for class; of equals the first, the largest."""
        best, index = 0.0, None
        self._log.confidence = 0.0
        for k, seen in enumerate(objects):
            if not seen.touches_border and seen.evidence:
                probability = seen.probabilities().get(self._target, 0.0)
                if probability * seen.certainty > best:
                    best, index = probability * seen.certainty, k
                    self._log.confidence = probability
        return index

    def choose(self, objects: list[SeenObject]) -> int | None:
        """The likeliest object, if it is likely enough to be touched."""
        index = self.likeliest(objects)
        return index if index is not None and self._may_take(objects[index]) else None

    def _may_take(self, seen: SeenObject) -> bool:
        """Whether an object is not unknown by the classifier's own threshold, and likely enough of the asked-for class,
        both among its classes and in all (`SeenObject.is_a`).
        """
        known = seen.known
        if known < 1 and known < getattr(self._classifier, "unknown_below", _UNKNOWN_BELOW):
            return False
        share = seen.probabilities().get(self._target, 0.0) / known
        return min(share, seen.is_a(self._target)) >= self._min_confidence

    def is_sure(self, objects: list[SeenObject]) -> bool:
        """Whether one look is enough: the object is likely, whole, and no other could be it."""
        if self.choose(objects) is None or self.doubt(objects) is not None:
            return False
        if self._classifier is None:
            return True
        probabilities = [seen.probabilities().get(self._target, 0.0) for seen in objects if seen.evidence]
        likely = self._log.confidence >= max(SURE, self._min_confidence)
        return likely and sum(p > _DOUBT for p in probabilities) == 1

    def is_found(self, objects: list[SeenObject]) -> bool:
        """Whether more than one look is enough: the object is likely and whole, whatever others may be; or two views
        at least show it so, it is rather known than not, and by both witnesses (`SeenObject.is_a`) as good as certain.
        """
        index = self.choose(objects)
        if index is None or self.doubt(objects) is not None:
            return False
        seen = objects[index]
        agree = len(seen.evidence) >= _AGREEING and seen.is_a(self._target) >= _BEYOND_DOUBT
        agree &= seen.known >= _UNKNOWN_BELOW  # a stranger may look like one class from every side
        return agree or self._log.confidence >= SURE

    def is_confirmed(self, objects: list[SeenObject], n_views: int) -> bool:
        """Whether the object that would be taken is surely the one, or more than one of so many views shows it so: of
        another object's piece, or of two in one, one view may look like the asked-for one, hardly the next. Nor, where
        others lie on it and must go up with it or slide off, may the segmenter and the classifier together speak
        against its being one whole thing. True where there is none to take.
        """
        index = self.choose(objects)
        if index is None or self.is_sure(objects):
            return True
        seen = objects[index]
        doubtful = log_odds(seen.certainty) + log_odds(seen.known) < 0
        if doubtful and not self._clear and lying_on(objects, index):
            return False
        return len(seen.evidence) >= min(_AGREEING, n_views) and _is_confirmed(seen)

    def is_absent(self, objects: list[SeenObject]) -> bool:
        """Whether nothing that was seen may be the asked-for one: each is surely something else, and surely whole, and
        none lies on another, which might hide it.
        """
        if self._classifier is None:
            return False
        told = [seen for seen in objects if seen.evidence]
        surely_others = all(
            seen.probabilities().get(self._target, 0.0) < POSSIBLE and seen.certainty >= CERTAIN for seen in told
        )
        return surely_others and not any(lying_on(told, k) for k in range(len(told)))

    def wish_to_look_again(self, objects: list[SeenObject]) -> str | None:
        """Why what was seen is not enough to touch the asked-for object, or to say that it is not there; or None."""
        if self.is_absent(objects) or self.is_sure(objects):
            return None
        if (doubt := self.doubt(objects)) is not None:
            return doubt
        if self._log.confidence < max(SURE, self._min_confidence):
            return f"whether one of them is a {self._target} is unsure ({self._log.confidence:.2f})"
        return f"more than one may be the {self._target}"

    def doubt(self, objects: list[SeenObject]) -> str | None:
        """Why another view of the likeliest object might show it otherwise, or None."""
        index = self.likeliest(objects)
        if index is None:
            return None
        certainty = objects[index].certainty
        if certainty < CERTAIN:
            return f"whether the {self._target} is one object is unsure ({certainty:.2f})"
        hidden = sum(lying_on(objects, index).values())
        if hidden > _HIDDEN and not self._clear:
            return f"something hides about {hidden:.0%} of the {self._target}"
        if self._clear and not hidden and stands_over(objects, index) is not None:
            seen_from = len(objects[index].viewpoints)
            return f"something may lie on the {self._target}" if seen_from < _VIEWS_TO_CLEAR else None
        return None

    def hidden_from(self, objects: list[SeenObject]) -> np.ndarray | None:
        """On which side, (2,), of the likeliest object something stands higher than it, or None."""
        index = self.likeliest(objects)
        return None if index is None else stands_over(objects, index)

    def decide(self, objects: list[SeenObject], view: View, q: np.ndarray | None) -> PlannedPick:
        """Which object to pick up, with which grasp and, from joint angles q (6,) rad, along which joint paths.

        view: the last look at the objects. Where there is no object, grasp or path, the result's `reason` says why.
        """
        chosen = self.choose(objects)
        if chosen is None:
            return PlannedPick(objects, None, None, None, self._log.confidence, NOT_FOUND)
        pushing = _PUSHED_M if len(objects) > 1 else _PUSHED_M[:1]
        if self._clear:
            # What lies on it, then itself.
            floor = floor_below(objects[chosen].points, view.surface, view.plane)
            order = [*uppermost_on(objects, chosen, floor), chosen]
            tries = [(k, pushed) for k in order for pushed in pushing]
        else:
            # With free ways for the fingers, then pushing.
            order = self._freest_first(objects, chosen)
            tries = [(k, pushed) for pushed in pushing for k in order]
        picks = []
        for k, pushed in tries:
            pick = PlannedPick(objects, k, None, None, self._log.confidence, None, clears=self._clear and k != chosen)
            picks.append(self._plan(pick, k, view, q, pushed))
            if _bite(picks[-1]) >= _HOLDS:
                break
        best = max(range(len(picks)), key=lambda i: _bite(picks[i]))  # of equals the first
        self._log.plan, self._log.chosen = picks[best].plan, picks[best].chosen
        if picks[best].reason is None and tries[best][1]:
            self._log.doubts.append("no free way for the fingers: they may push a neighbour aside")
        return picks[best]

    def _freest_first(self, objects: list[SeenObject], chosen: int) -> list[int]:
        """The chosen object, and before it where something lies on it, after it where not, others that surely are of
        the class, too, and on which nothing lies.
        """
        others = [
            k for k, seen in enumerate(objects) if k != chosen and self._is_surely(seen) and not lying_on(objects, k)
        ]
        others.sort(key=lambda k: -objects[k].trust)
        return [*others, chosen] if lying_on(objects, chosen) else [chosen, *others]

    def _is_surely(self, seen: SeenObject) -> bool:
        """Whether it is one whole object of the asked-for class, as good as certainly."""
        whole = not seen.touches_border and seen.certainty >= CERTAIN
        return whole and self._may_take(seen) and seen.is_a(self._target) >= SURE

    def why_not_taken(
        self, taken: SeenObject, others: list[SeenObject], observation: RobotObservation, plane: np.ndarray | None
    ) -> str | None:
        """After lifting, why the hand does not hold the asked-for object, which was seen as ``taken``; or None.

        Where one of the ``others`` lay that was not likely of the asked-for class, something may now surely be: then
        what was taken for it was something else, or somebody put another thing in its place.
        """
        if still_there(taken, observation, plane):
            return "it is still on the table"
        places = [seen for seen in others if seen.probabilities().get(self._target, 0.0) < _DOUBT]
        if self._classifier is None or not places:
            return None
        for seen in self._classified(look, observation, self._segmenter).objects:
            if self._is_surely(seen) and any(is_near(seen, other) for other in places):
                return f"holds something else: the {self._target} lies where another thing was"
        return None

    def _planner_for(self, seen: SeenObject, clears: bool) -> GraspPlanner:
        """One that has models is told the class: that asked for, of what lies on it the likeliest."""
        shares = seen.probabilities()
        return told_class(self._planner, max(shares, key=shares.__getitem__) if clears else self._target)

    def _plan(self, pick: PlannedPick, chosen: int, view: View, q: np.ndarray | None, pushed: float) -> PlannedPick:
        """The pick with grasp and paths; pushed: how far [m] the fingers may push the object's neighbours aside."""
        objects = pick.objects
        points = objects[chosen].points
        neighbours = [seen.points for k, seen in enumerate(objects) if k != chosen]
        others = np.concatenate(
            [view.obstacles, *(without_rim(each, pushed) if pushed else each for each in neighbours)]
        )
        plane = floor_below(points, view.surface, view.plane)
        planner = self._planner_for(objects[chosen], pick.clears)

        def grasps(planner: GraspPlanner) -> GraspPlan:
            with self._log.timed("plan grasp"):
                return planner.plan(
                    points,
                    up=UP,
                    table=plane,
                    obstacles=others,
                    viewpoint=objects[chosen].viewpoints if len(objects[chosen].viewpoints) else None,
                    unseen=objects[chosen].unseen,
                )

        plan = grasps(planner)
        self._log.plan, self._log.chosen = plan, chosen
        if plan.source is not None and plan.source.startswith(ModelPlanner.FELL_BACK):
            self._log.doubts.append(f"planned on {plan.source}")
        planned = replace(pick, plan=plan)
        if plan.best is None:
            return replace(planned, reason=f"no grasp: {plan.reason}")
        with self._log.timed("plan motion"):
            if q is None:
                T_base_grasp, T_base_tool0, opening = grasp_to_carry_out(plan.best, plane)
                approach, width = None, plan.best.width
            else:
                try:
                    approach = plan_approach(plan, points, others, plane, q, view.observation.arm)
                except MotionError as error:
                    tilted = _tilting(planner, plan)
                    if tilted is None or (plan := grasps(tilted)).best is None:
                        return replace(planned, reason=f"no motion: {error}")
                    self._log.plan, planned = plan, replace(planned, plan=plan)
                    try:
                        approach = plan_approach(plan, points, others, plane, q, view.observation.arm)
                    except MotionError:
                        return replace(planned, reason=f"no motion: {error}")
                T_base_grasp, T_base_tool0 = approach.T_base_grasp, approach.T_base_tool0
                opening, width = approach.opening, approach.grasp.width
        return replace(
            planned,
            approach=approach,
            T_base_grasp=T_base_grasp,
            T_base_tool0=T_base_tool0,
            width=width,
            opening=opening,
        )


def _tilting(planner: GraspPlanner, plan: GraspPlan) -> GraspPlanner | None:
    """What plans grasps from askew, where the plan has only such from straight above and there is such a planner."""
    if not isinstance(planner, CurvaturePlanner) or planner.max_tilt <= 0.0:
        return None
    if any(grasp.terms["tilt"] > 0.0 for grasp in plan.candidates):
        return None
    tilting = copy(planner)
    tilting.min_tilt = 1e-3
    return tilting


def _bite(pick: PlannedPick) -> float:
    """How surely the grasp's pads reach deep enough to hold, 0 to 1; -1 where there is no grasp."""
    if pick.reason is not None or pick.plan is None or pick.plan.best is None:
        return -1.0
    grasp = pick.plan.best if pick.approach is None else pick.approach.grasp
    return float(grasp.terms.get("bite", 1.0))


def _is_confirmed(seen: SeenObject) -> bool:
    return seen.certainty >= CERTAIN or len(seen.evidence) >= _AGREEING


def _with_pairs(observation: RobotObservation, segmenter: Segmenter) -> View:
    return look(observation, segmenter).with_pairs()


def _with_rest(view: View, pixels: list[np.ndarray]) -> View:
    """The view, with what of its objects is in none of those of these pixels as obstacles."""
    if pixels is view.pixels:
        return view
    gone = np.isin(
        np.concatenate([np.empty(0, np.int64), *view.pixels]), np.concatenate([np.empty(0, np.int64), *pixels])
    )
    points = np.concatenate([np.empty((0, 3)), *(each.points for each in view.objects)])
    return replace(view, obstacles=np.concatenate([view.obstacles, points[~gone]]))
