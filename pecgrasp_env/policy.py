"""A scripted expert for SelectiveGrasp-v1: look, tell the objects apart, plan, approach, close, lift, and see whether
it worked.

It knows what a robot in a laboratory knows: the depth picture of the wrist camera, the joint angles, the opening of the
gripper and the name of the class that is asked for. The plan of an episode is one generator, `_episode`, that is read
from the top: each ``yield`` is one control step. Actions are those of the control mode `pd_joint_pos`.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from grasping import ROBOTIQ_2F_140, CurvaturePlanner, Grasp, GraspPlan, Segmenter
from pecgrasp_env.approach import Approach, plan_approach
from pecgrasp_env.motion import MotionError, joint_move, straight_line, time_law
from pecgrasp_env.perception import UP, Percept, SeenObject, class_probabilities, look, merge, read_observation
from pecgrasp_env.robot import forward_kinematics
from pecgrasp_env.views import look_postures

NOT_FOUND = "not found"

Steps = Generator[np.ndarray, Percept, Any]

_FORCE_N = 60.0
_APPROACH_SPEED = 0.5
_LIFT_SPEED = 0.6
_EMPTY_OPENING_M = 0.002  # the thinnest thing that counts as held
_STILL_OPENING_M = 0.0003  # a gripper whose opening changes by less within a step has stopped
_LONGEST_CLOSING_STEPS = 30
_OPENING_STEPS = 10
_SAFE_TOOL_M = 0.45  # height of tool0 at which the fingertips pass over everything on the table
_SETTLED_RAD = 0.01
# Following a path of half speed the arm lags by 0.015 rad and the opening by less than 0.1 mm.
_BLOCKED_RAD = 0.03
_BLOCKED_OPENING_M = 0.0015
_LONGEST_SETTLING_STEPS = 15


@dataclass
class PolicyLog:
    """What happened in an episode, for reports.

    stages: seconds spent in each stage, one number each time it ran. failures: why each try failed that did.
    plan, chosen_points, label, probabilities: of the last try. reason: why the policy gave up, or None.
    """

    stages: dict[str, list[float]] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    views: int = 0
    plan: GraspPlan | None = None
    grasp: Grasp | None = None
    objects: list[SeenObject] = field(default_factory=list)
    chosen: int | None = None
    confidence: float = 0.0
    reason: str | None = None
    lifted: bool = False
    doing: str = ""  # in words, for captions

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.stages.setdefault(stage, []).append(time.perf_counter() - start)


class ScriptedPolicy:
    """Picks the object of the asked-for class.

    Args:
        classifier: a `pec.Classifier`, or any callable cloud (M, 3) in the camera frame → (label, confidence).
        planner: what finds grasps on a cloud in the base frame; the default is `CurvaturePlanner` for the 2F-140.
        segmenter: what finds objects in a cloud.
        control_dt: seconds between two calls of `act`.
        min_confidence: probability of the asked-for class below which an object is not touched.
        attempts: how many times to try before giving up.
    """

    def __init__(
        self,
        classifier: Any,
        planner: Any = None,
        segmenter: Segmenter | None = None,
        *,
        control_dt: float = 0.05,
        min_confidence: float = 0.6,
        attempts: int = 3,
    ) -> None:
        if not 0 < min_confidence <= 1:
            raise ValueError(f"min_confidence={min_confidence}: must be in (0, 1]")
        if attempts < 1:
            raise ValueError(f"attempts={attempts}: must be at least 1")
        self.classifier = classifier
        self.planner = planner if planner is not None else CurvaturePlanner(ROBOTIQ_2F_140)
        self.segmenter = segmenter if segmenter is not None else Segmenter()
        self.control_dt = control_dt
        self.min_confidence = min_confidence
        self.attempts = attempts
        self.log = PolicyLog()
        self._target: str | None = None
        self._steps: Steps | None = None
        self._command = np.zeros(8, np.float32)

    def reset(self, target: str) -> None:
        """Begin an episode in which an object of class ``target`` is asked for.

        Raises ValueError for a class that the classifier was not trained on: it could never be found.
        """
        known = getattr(self.classifier, "classes", None)
        if known is not None and target not in known:
            raise ValueError(f"target={target!r}: the classifier knows only {', '.join(known)}")
        self.log = PolicyLog()
        self._target = target
        self._steps = None

    @property
    def done(self) -> bool:
        """Whether the policy has lifted something or given up; it then holds still."""
        return self.log.lifted or self.log.reason is not None

    def act(self, obs: Mapping[str, Any]) -> np.ndarray:
        """The next action (8,) float32 of `pd_joint_pos`: joint targets rad, opening m, force limit N."""
        if self._target is None:
            raise RuntimeError("call reset(target) before act(obs)")
        percept = read_observation(obs)
        try:
            if self._steps is None:
                self._command = np.array([*percept.q, ROBOTIQ_2F_140.stroke, _FORCE_N], np.float32)
                self._steps = self._episode(percept)
                return next(self._steps)
            return self._steps.send(percept)
        except StopIteration:
            return self._command

    # ------------------------------------------------------------------------------------------------- the plan

    def _episode(self, percept: Percept) -> Steps:
        for attempt in range(self.attempts):
            objects, view, percept = yield from self._survey(percept, first_view=attempt)
            chosen = self._choose(objects)
            if chosen is None:
                self.log.failures.append(NOT_FOUND)
                continue
            others = [seen.points for k, seen in enumerate(objects) if k != chosen]
            obstacles = np.concatenate([view.obstacles, *others])
            with self.log.timed("plan grasp"):
                plan = self.planner.plan(objects[chosen].points, up=UP, table=view.plane, obstacles=obstacles)
            self.log.plan, self.log.chosen = plan, chosen
            if plan.best is None:
                self.log.failures.append(f"no grasp: {plan.reason}")
                continue
            try:
                with self.log.timed("plan motion"):
                    approach = plan_approach(plan, objects[chosen].points, obstacles, view.plane, percept.q)
            except MotionError as error:
                self.log.failures.append(f"no motion: {error}")
                continue
            self.log.grasp = approach.grasp
            held, percept = yield from self._pick(approach, percept)
            if held:
                self.log.lifted = True
                self.log.doing = "holding it"
                return
            percept = yield from self._retreat(percept)
        self.log.reason = self.log.failures[-1]
        self.log.doing = f"gave up: {self.log.reason}"

    def _survey(self, percept: Percept, first_view: int) -> Steps:
        """Look from one posture after another until an object of the asked-for class stands out, or none are left."""
        objects: list[SeenObject] = []
        postures = look_postures()
        for k in range(len(postures)):
            posture = postures[(first_view + k) % len(postures)]
            self.log.doing = f"looking, view {self.log.views + 1}"
            percept = yield from self._go(joint_move(percept.q, posture), percept, opening=ROBOTIQ_2F_140.stroke)
            with self.log.timed("segment"):
                view = look(percept, self.segmenter)
            with self.log.timed("classify"):
                for seen, cloud in zip(view.objects, view.clouds, strict=True):
                    if len(cloud) >= getattr(self.classifier, "n_points", 1):
                        seen.evidence.append(class_probabilities(self.classifier, cloud))
            objects = merge(objects, view.objects)
            self.log.views += 1
            self.log.objects = objects
            if self._choose(objects) is not None:
                break
        return objects, view, percept

    def _choose(self, objects: list[SeenObject]) -> int | None:
        """The object that is likeliest of the asked-for class, if that is likely enough."""
        best, index = 0.0, None
        for k, seen in enumerate(objects):
            if not seen.touches_border and seen.evidence:
                probability = seen.probabilities().get(str(self._target), 0.0)
                if probability > best:
                    best, index = probability, k
        self.log.confidence = best
        return index if best >= self.min_confidence else None

    def _pick(self, approach: Approach, percept: Percept) -> Steps:
        """Go there, close, lift; whether something is held is read off the opening, as on the real gripper."""
        self.log.doing = "moving over the object"
        percept = yield from self._go(approach.to_pregrasp, percept, opening=approach.opening)
        self.log.doing = "coming down"
        percept = yield from self._go(
            approach.to_grasp, percept, opening=approach.opening, speed=_APPROACH_SPEED, careful=True
        )
        if self._blocked(percept, approach.opening):
            self.log.failures.append("touched something on the way down")
            return False, percept
        self.log.doing = "closing"
        percept = yield from self._close(percept)
        if percept.opening < _EMPTY_OPENING_M:
            self.log.failures.append("closed on nothing")
            return False, percept
        closed = percept.opening
        self.log.doing = "lifting"
        percept = yield from self._go(approach.to_lift, percept, opening=0.0, speed=_LIFT_SPEED)
        percept = yield from self._close(percept)
        if percept.opening < max(_EMPTY_OPENING_M, 0.5 * closed):
            self.log.failures.append("lost while lifting")
            return False, percept
        return True, percept

    def _retreat(self, percept: Percept) -> Steps:
        """Open, and go straight up where the hand is still among the objects."""
        self.log.doing = "letting go"
        for _ in range(_OPENING_STEPS):
            percept = yield self._action(self._command[:6], ROBOTIQ_2F_140.stroke)
        T = forward_kinematics(percept.q)
        for height in np.arange(_SAFE_TOOL_M - T[2, 3], 0.0, -0.05):
            T_up = T.copy()
            T_up[2, 3] += height
            try:
                line = straight_line(percept.q, T, T_up)
            except MotionError:
                continue
            return (yield from self._go(line, percept, opening=ROBOTIQ_2F_140.stroke))
        return percept

    # ------------------------------------------------------------------------------------------------ small steps

    def _action(self, q: np.ndarray, opening: float) -> np.ndarray:
        self._command = np.array([*q, opening, _FORCE_N], np.float32)
        return self._command

    def _go(
        self, waypoints: np.ndarray, percept: Percept, *, opening: float, speed: float = 1.0, careful: bool = False
    ) -> Steps:
        """Follow joint waypoints (K, 6) and wait until the arm is there; ``careful`` stops where something resists."""
        for q in time_law(waypoints, self.control_dt, speed):
            percept = yield self._action(q, opening)
            if careful and self._blocked(percept, opening):
                return (yield self._action(percept.q, opening))
        for _ in range(_LONGEST_SETTLING_STEPS):
            if np.abs(percept.q - waypoints[-1]).max() < _SETTLED_RAD:
                break
            percept = yield self._action(waypoints[-1], opening)
        return percept

    def _blocked(self, percept: Percept, opening: float) -> bool:
        """Whether the arm or the fingers are kept from where they were sent, further than they lag by themselves."""
        lag = float(np.abs(percept.q - self._command[:6]).max())
        return lag > _BLOCKED_RAD or abs(percept.opening - opening) > _BLOCKED_OPENING_M

    def _close(self, percept: Percept) -> Steps:
        """Close and wait until the fingers stand still, on something or on each other."""
        q = self._command[:6]
        still = 0
        for _ in range(_LONGEST_CLOSING_STEPS):
            before = percept.opening
            percept = yield self._action(q, 0.0)
            still = still + 1 if abs(percept.opening - before) < _STILL_OPENING_M else 0
            if still == 3:
                break
        return percept
