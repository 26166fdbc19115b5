"""A scripted expert for SelectiveGrasp-v1: look, tell the objects apart, plan, approach, close, lift, and see whether
it worked.

It knows what a robot in a laboratory knows: the depth picture of the wrist camera, the joint angles, the opening and
force of the gripper and the name of the class that is asked for. The plan of an episode is one generator, `_episode`,
read from the top: each ``yield`` is one control step. Actions are those of the control mode `pd_joint_pos`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grasping import ROBOTIQ_2F_140, CurvaturePlanner, Segmenter
from pecgrasp_env.motion.collision import Clearance
from pecgrasp_env.motion.grasp_approach import Approach, plan_approach
from pecgrasp_env.motion.trajectory import MotionError
from pecgrasp_env.policy.arm_primitives import ArmSteps, Steps
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.perception import (
    Percept,
    SeenObject,
    View,
    class_probabilities,
    look,
    merge,
    percept_of,
    read_observation,
    still_there,
)
from pecgrasp_env.policy.planned_pick import PlannedPick
from pecgrasp_env.policy.viewpoints import look_postures, posture_above
from pecgrasp_env.robot.kinematics import UP
from pecgrasp_env.sensor import CameraIntrinsics

NOT_FOUND = "not found"

_FORCE_N, _FIRM_FORCE_N = 60.0, 100.0  # the second where an object slipped out before
_APPROACH_SPEED = 0.5
_LIFT_SPEED = 0.6
_EMPTY_OPENING_M = 0.002  # the thinnest thing that counts as held
_LEAST_FORCE_N = 2.0  # between the pads; the grip's own limit is never below 10 N
_LOST_SHARE = 0.5  # of the opening with which it was first held
_TOO_WIDE_M = 0.020  # beyond the planned width: there is something else between the pads
_SURE, _DOUBT = 0.9, 0.3  # probability from which one look is enough; of a rival, from which it is not


class ScriptedPolicy:
    """Picks the object of the asked-for class.

    Args:
        classifier: a `pec.Classifier`, or any callable cloud (M, 3) in the camera frame → (label, confidence). None:
            whatever lies on the table is of the asked-for class, and the largest thing is taken.
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
        self._arm: ArmSteps

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
        if self._steps is None:
            self._arm = ArmSteps(percept, self.control_dt, _FORCE_N)
            self._steps = self._episode(self._arm, percept)
            return next(self._steps)
        try:
            return self._steps.send(percept)
        except StopIteration:
            return self._arm.command

    def plan_only(
        self,
        depth: ArrayLike,
        intrinsics: CameraIntrinsics,
        T_base_camera: ArrayLike,
        target: str,
        *,
        q: ArrayLike | None = None,
        opening: float | None = None,
    ) -> PlannedPick:
        """From one depth picture to a grasp on the object of class ``target``, for an arm that others move.

        Nothing moves and no simulator is needed; `log` tells the stages' times.

        Args:
            depth: (H, W) metres along the optical axis, 0 or NaN where there is none.
            intrinsics: of the camera.
            T_base_camera: (4, 4), camera frame (OpenCV) into the robot's base frame, whose z axis points up.
            target: the class that is asked for.
            q: (6,) rad, where a UR5 is now; with it the joint paths are planned, too.
            opening: m, of a 2F-140 that carries the camera as this project's bracket does: its own fingers are then cut
                out of the picture. None: the picture shows no gripper.

        Raises ObservationError for a picture, a pose or joint angles of the wrong shape, ValueError as `reset` does.
        """
        percept = percept_of(depth, intrinsics, T_base_camera, q, opening)
        self.reset(target)
        objects, view = self._look(percept, [])
        chosen = self._choose(objects)
        if chosen is None:
            return PlannedPick(objects, None, None, None, self.log.confidence, NOT_FOUND)
        pick = PlannedPick(objects, chosen, self._plan(objects, chosen, view), None, self.log.confidence, None)
        with self.log.timed("plan motion"):
            return pick.completed(None if q is None else percept.q, self._around(objects, chosen, view), view.plane)

    def _episode(self, arm: ArmSteps, percept: Percept) -> Steps:
        for attempt in range(self.attempts):
            objects, view, percept = yield from self._survey(arm, percept, attempt)
            chosen = self._choose(objects)
            if chosen is None:
                self.log.failures.append(NOT_FOUND)
                continue
            plan = self._plan(objects, chosen, view)
            if plan.best is None:
                self.log.failures.append(f"no grasp: {plan.reason}")
                continue
            try:
                with self.log.timed("plan motion"):
                    around = self._around(objects, chosen, view)
                    approach = plan_approach(plan, objects[chosen].points, around, view.plane, percept.q)
            except MotionError as error:
                self.log.failures.append(f"no motion: {error}")
                continue
            self.log.grasp = approach.grasp
            failure, percept = yield from self._pick(arm, approach, percept)
            if failure is None and still_there(objects[chosen], percept, view.plane):
                failure = "it is still on the table"
                percept = yield from arm.go(approach.to_lift[::-1], percept, opening=0.0, speed=_LIFT_SPEED)
            if failure is None:
                self.log.lifted = True
                self.log.doing = "holding it"
                return
            self.log.failures.append(failure)
            self.log.doing = "letting go"
            percept = yield from arm.let_go(percept)
            percept = yield from arm.rise(percept)
        self.log.reason = self.log.failures[-1]
        self.log.doing = f"gave up: {self.log.reason}"

    def _survey(self, arm: ArmSteps, percept: Percept, attempt: int) -> Steps:
        """Look from one posture after another until an object of the asked-for class stands out, or none are left."""
        objects: list[SeenObject] = []
        view: View | None = None
        postures = look_postures()
        for k in range(len(postures)):
            q = postures[(attempt + k) % len(postures)]
            likeliest = self._likeliest(objects)
            if k > 0 and likeliest is not None:  # from straight above, nothing hides behind its neighbours
                q = posture_above(objects[likeliest].centroid, k)
            self.log.doing = f"looking, view {self.log.views + 1}"
            way = self._way(objects, view, percept.q, q)
            percept = yield from arm.go(way, percept, opening=ROBOTIQ_2F_140.stroke)
            objects, view = self._look(percept, objects)
            if self._is_sure(objects) or (k > 0 and self._choose(objects) is not None):
                break
        return objects, view, percept

    def _look(self, percept: Percept, known: list[SeenObject]) -> tuple[list[SeenObject], View]:
        """One picture's objects, joined with those known."""
        _ = percept.picture  # a simulated camera draws it only now, and that is not part of segmenting
        with self.log.timed("segment"):
            view = look(percept, self.segmenter)
        with self.log.timed("classify"):
            if self.classifier is None:
                answers = [{str(self._target): 1.0} for _ in view.clouds]
            else:
                answers = class_probabilities(self.classifier, view.clouds)
            for seen, answer in zip(view.objects, answers, strict=True):
                seen.evidence += [answer] if answer else []
        objects = merge(known, view.objects)
        self.log.views += 1
        self.log.objects = objects
        return objects, view

    def _likeliest(self, objects: list[SeenObject]) -> int | None:
        """The object that is likeliest of the asked-for class; of equals the first, which is the largest."""
        best, index = 0.0, None
        for k, seen in enumerate(objects):
            if not seen.touches_border and seen.evidence:
                probability = seen.probabilities().get(str(self._target), 0.0)
                if probability > best:
                    best, index = probability, k
        self.log.confidence = best
        return index

    def _choose(self, objects: list[SeenObject]) -> int | None:
        """The likeliest object, if it is likely enough."""
        index = self._likeliest(objects)
        return index if self.log.confidence >= self.min_confidence else None

    def _is_sure(self, objects: list[SeenObject]) -> bool:
        """Whether one look is enough: the object is likely, and no other could be it."""
        index = self._likeliest(objects)
        if self.classifier is None:
            return index is not None
        rivals = [seen.probabilities().get(str(self._target), 0.0) for seen in objects if seen.evidence]
        return self.log.confidence >= max(_SURE, self.min_confidence) and sum(p > _DOUBT for p in rivals) == 1

    def _plan(self, objects: list[SeenObject], chosen: int, view: View) -> Any:
        around = self._around(objects, chosen, view)
        with self.log.timed("plan grasp"):
            plan = self.planner.plan(objects[chosen].points, up=UP, table=view.plane, obstacles=around)
        self.log.plan, self.log.chosen = plan, chosen
        return plan

    @staticmethod
    def _around(objects: list[SeenObject], chosen: int, view: View) -> np.ndarray:
        """Points (K, 3) of all but the chosen object."""
        return np.concatenate([view.obstacles, *(seen.points for k, seen in enumerate(objects) if k != chosen)])

    @staticmethod
    def _way(objects: list[SeenObject], view: View | None, q_start: np.ndarray, q_goal: np.ndarray) -> np.ndarray:
        """From one view to another past what was seen; straight where nothing was, or where no way is found."""
        if view is not None and view.plane is not None:
            seen = np.concatenate([view.obstacles, *(each.points for each in objects)])
            try:
                return Clearance(np.zeros((0, 3)), seen, view.plane).way(q_start, q_goal)
            except MotionError:
                pass
        return np.stack([q_start, q_goal])

    def _pick(self, arm: ArmSteps, approach: Approach, percept: Percept) -> Steps:
        """Go there, close, lift. Returns why it failed, or None, and the percept: whether something is held is read off
        the opening and the force, as on the real gripper.
        """
        slipped = any(failure.startswith("lost") for failure in self.log.failures)
        arm.force = _FIRM_FORCE_N if slipped else _FORCE_N
        self.log.doing = "moving over the object"
        percept = yield from arm.go(approach.to_pregrasp, percept, opening=approach.opening)
        self.log.doing = "coming down"
        percept = yield from arm.go(
            approach.to_grasp, percept, opening=approach.opening, speed=_APPROACH_SPEED, careful=True
        )
        if arm.blocked(percept, approach.opening):
            return "touched something on the way down", percept
        self.log.doing = "closing"
        percept = yield from arm.close(percept)
        self.log.held_m, self.log.held_n = percept.opening, percept.force
        if percept.opening < _EMPTY_OPENING_M or _nothing_pressed(percept):
            return "closed on nothing", percept
        if percept.opening > approach.grasp.width + _TOO_WIDE_M:
            found, planned = percept.opening * 1e3, approach.grasp.width * 1e3
            return f"holds something {found:.0f} mm wide where {planned:.0f} mm were planned", percept
        closed = percept.opening
        self.log.doing = "lifting"
        percept = yield from arm.go(approach.to_lift, percept, opening=0.0, speed=_LIFT_SPEED)
        percept = yield from arm.close(percept)
        lost = percept.opening < max(_EMPTY_OPENING_M, _LOST_SHARE * closed) or _nothing_pressed(percept)
        return ("lost while lifting" if lost else None), percept


def _nothing_pressed(percept: Percept) -> bool:
    return percept.force is not None and percept.force < _LEAST_FORCE_N
