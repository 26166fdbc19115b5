"""A scripted expert for SelectiveGrasp-v1: look, classify, plan, approach, close, lift, and see whether it worked.

It knows what a robot in a laboratory knows: the depth frame of the wrist camera, the joint angles, the opening and
force of the gripper and the name of the class that is asked for. The plan of an episode is one generator, `_episode`,
read from the top: each ``yield`` is one control step. Actions are those of the control mode `pd_joint_pos`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from grasping import ROBOTIQ_2F_140, CurvaturePlanner, Segmenter
from pecgrasp_env.motion.clearance import path_past
from pecgrasp_env.policy.arm_primitives import ArmSteps, Steps
from pecgrasp_env.policy.crowd import borne_by
from pecgrasp_env.policy.grip_force import grip_force
from pecgrasp_env.policy.holding import LIFT_SPEED, lift, put_down, take_hold, tipped_lift
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.observation import RobotObservation, observation_of_frame, read_observation
from pecgrasp_env.policy.perception import View
from pecgrasp_env.policy.pick_planner import NOT_FOUND, PickPlanner
from pecgrasp_env.policy.planned_pick import PlannedPick
from pecgrasp_env.policy.seen_objects import SeenObject
from pecgrasp_env.policy.tip_off import TippedLift
from pecgrasp_env.policy.viewpoints import look_postures, posture_above, posture_beside
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_WAITING_FORCE_N = 60.0  # of a gripper that holds nothing
_MOST_CLEARED = 8
_MOST_SURVEYS = 2  # in which nothing was found: a third one shows the same


class ScriptedPolicy:
    """Picks the object of the asked-for class.

    Args:
        classifier: a `pec.Classifier`, or any callable cloud (M, 3) in the camera frame → (label, confidence). None:
            whatever lies on the table is of the asked-for class, and the largest thing is taken.
        planner: what finds grasps on a cloud in the base frame; the default is `CurvaturePlanner` for the 2F-140.
        segmenter: what finds objects in a cloud.
        control_dt: seconds between two calls of `act`.
        min_confidence: probability of the asked-for class, among those of the classifier and in all
            (`SeenObject.is_a`), below which an object is not touched; nor is one that the classifier's threshold calls
            unknown.
        attempts: how many times to try before giving up.
        clear: take away what lies on the asked-for object and put it down on the free table, first; without, the object
            is tipped while it is lifted, so that they slide off.
        answers: actions are (9,), for a task with ``absent``: the last number is 1 once it says that nothing of the
            asked-for class is there, which is when it has looked from all its places and nothing may be it; else -1.
        T_tool0_camera: (4, 4), how the camera is mounted, from a calibration (`pecgrasp_env.robot.camera_mount`), for
            the postures from which it looks; the default is this project's bracket.
        look_from: joint angles (6,) of other postures to look in, such as `viewpoints.aside()` for a camera that stands
            beside the robot.
        arm: which arm it is for; its observations say so, too.
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
        clear: bool = False,
        answers: bool = False,
        T_tool0_camera: ArrayLike = T_TOOL0_CAMERA,
        look_from: Sequence[np.ndarray] | None = None,
        arm: ArmLengths = UR5,
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
        self.clear = clear
        self.answers = answers
        self.T_tool0_camera = np.asarray(T_tool0_camera, float)
        self._goes_round = look_from is None  # the hand carries the camera
        self._look_from = look_postures(self.T_tool0_camera, arm) if look_from is None else tuple(look_from)
        self.arm_lengths = arm
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

    @property
    def way(self) -> np.ndarray | None:
        """Joint waypoints (K, 6), rad, that the arm is sent along, or was last; None before the first step."""
        return None if self._steps is None else self._arm.way

    def act(self, obs: Mapping[str, Any]) -> np.ndarray:
        """The next action (8,) float32 of `pd_joint_pos`: joint targets rad, opening m, force limit N; with ``answers``
        (9,).
        """
        action = self.step(read_observation(obs))
        return np.append(action, np.float32(1.0 if self.log.absent else -1.0)) if self.answers else action

    def step(self, observation: RobotObservation) -> np.ndarray:
        """The next action (8,) float32, as `act` gives it, from an observation of a robot of one's own."""
        if self._target is None:
            raise RuntimeError("call reset(target) before act(obs)")
        if self._steps is None:
            self._arm = ArmSteps(observation, self.control_dt, _WAITING_FORCE_N)
            self._steps = self._episode(self._pick_planner(self._target), self._arm, observation)
            return next(self._steps)
        try:
            return self._steps.send(observation)
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
        before: PlannedPick | None = None,
    ) -> PlannedPick:
        """From one depth frame to a grasp on the object of class ``target``, for an arm that others move.

        Nothing moves and no simulator is needed; `log` has the stages' times. Where the result's `doubt` says why one
        view is not enough, move the camera and ask again with what was seen ``before``.

        Args:
            depth: (H, W) metres along the optical axis, 0 or NaN where there is none.
            intrinsics: of the camera.
            T_base_camera: (4, 4), camera frame (OpenCV) into the robot's base frame, whose z axis points up.
            target: the class that is asked for.
            q: (6,) rad, where the arm is now; with it the joint paths are planned, too, and the arm is cut out of the
                frame, wherever the camera stands.
            opening: m, of its 2F-140, which is then cut out as well; without q, of one that carries the camera as this
                project's bracket does. None: the frame shows no gripper.
            before: the answer to the view before, of the same untouched scene and target: what both saw counts.

        Raises ObservationError for a frame, a pose or joint angles of the wrong shape, ValueError as `reset` does.
        """
        observation = observation_of_frame(depth, intrinsics, T_base_camera, q, opening, self.arm_lengths)
        self.reset(target)
        pick_planner = self._pick_planner(target)
        known = [] if before is None else [replace(seen, evidence=list(seen.evidence)) for seen in before.objects]
        objects, view = pick_planner.look(observation, known)
        pick = pick_planner.decide(objects, view, None if q is None else observation.q)
        absent = pick.reason == NOT_FOUND and pick_planner.is_absent(objects)
        return replace(pick, doubt=pick_planner.wish_to_look_again(objects), absent=absent)

    def _pick_planner(self, target: str) -> PickPlanner:
        return PickPlanner(
            self.classifier, self.planner, self.segmenter, self.min_confidence, target, self.log, self.clear
        )

    def _episode(self, pick_planner: PickPlanner, arm: ArmSteps, observation: RobotObservation) -> Steps:
        objects: list[SeenObject] = []
        while len(self.log.failures) < self.attempts and self.log.cleared <= _MOST_CLEARED:
            objects, views, observation = yield from self._survey(pick_planner, arm, observation, objects)
            if not pick_planner.is_confirmed(objects, len(views)):
                self.log.failures.append(NOT_FOUND)
                self.log.doubts.append(f"what may be the {self._target} is too unsure to be touched")
                if self.log.failures.count(NOT_FOUND) == _MOST_SURVEYS:
                    break
                continue
            pick = pick_planner.decide(objects, views[-1], observation.q)
            if pick.approach is None or pick.chosen is None:
                self.log.failures.append(str(pick.reason))
                surveys = self.log.failures.count(NOT_FOUND)
                if pick.reason == NOT_FOUND and (pick_planner.is_absent(objects) or surveys == _MOST_SURVEYS):
                    break
                objects = [] if pick.chosen is None else objects
                continue
            approach, taken = pick.approach, objects[pick.chosen]
            upon = [objects[k].points for k in borne_by(objects, pick.chosen, views[-1].plane)]
            beside = [each for each in objects if each is not taken]
            others = [views[-1].obstacles, *(each.points for each in beside)]
            objects = []  # what is touched may move
            self.log.grasp = approach.grasp
            slipped = any(failure.startswith("lost") for failure in self.log.failures)
            arm.force = grip_force(taken.points, views[-1].plane, slipped)
            failure, observation = yield from take_hold(arm, self.log, approach, observation)
            tipped: TippedLift | None = None
            if failure is None and upon:
                failure, tipped = tipped_lift(arm, self.log, approach, taken, upon, others, views[-1])
            if failure is None:
                failure, lifted, observation = yield from lift(arm, self.log, approach, tipped, observation)
                if failure is None:
                    surely = [] if pick.clears or upon else beside  # in a heap what is taken may uncover others
                    failure = pick_planner.why_not_taken(taken, surely, observation, views[-1].plane)
                    if failure is not None:
                        observation = yield from arm.go(lifted[::-1], observation, opening=0.0, speed=LIFT_SPEED)
            if failure is None and not pick.clears:
                self.log.lifted = True
                self.log.doing = "holding it"
                return
            if failure is None:
                failure, observation = yield from put_down(
                    arm, self.log, taken, lifted, views, self.arm_lengths, observation
                )
            if failure is None:
                continue
            self.log.failures.append(failure)
            self.log.doing = "letting go"
            observation = yield from arm.let_go(observation)
            observation = yield from arm.rise(observation)
        many = f"{self.log.cleared} objects taken away, and there are more"
        self.log.reason = many if self.log.cleared > _MOST_CLEARED else self.log.failures[-1]
        # What it once had before it is there, wherever it lies now.
        self.log.absent = all(failure == NOT_FOUND for failure in self.log.failures) and self.log.reason == NOT_FOUND
        self.log.doing = f"gave up: {self.log.reason}"

    def _survey(
        self, pick_planner: PickPlanner, arm: ArmSteps, observation: RobotObservation, objects: list[SeenObject]
    ) -> Steps:
        """Look from one posture after another until an object of the asked-for class stands out, or none are left.

        objects: seen before, and not touched since. Returns the objects, the views, and the last observation.
        """
        views: list[View] = []
        for k in range(len(self._look_from)):
            q = self._next_posture(pick_planner, objects, k)
            self.log.doing = f"looking, view {self.log.views + 1}"
            path = self._path(objects, views[-1] if views else None, observation.q, q)
            observation = yield from arm.go(path, observation, opening=ROBOTIQ_2F_140.stroke)
            objects, view = pick_planner.look(observation, objects)
            views.append(view)
            if pick_planner.is_sure(objects) or (k > 0 and pick_planner.is_found(objects)):
                return objects, views, observation
        if (doubt := pick_planner.doubt(objects)) is not None:
            self.log.doubts.append(f"after {len(views)} views: {doubt}")
        return objects, views, observation

    def _next_posture(self, pick_planner: PickPlanner, objects: list[SeenObject], k: int) -> np.ndarray:
        """From where to look for the k-th time in a survey."""
        likeliest = pick_planner.likeliest(objects) if k > 0 and self._goes_round else None
        if likeliest is not None:
            place, hides = objects[likeliest].centroid, pick_planner.hidden_from(objects)
            if hides is not None and pick_planner.doubt(objects) is not None:
                # Below what hides it: from the other side, then from beside.
                turn = np.deg2rad((180.0, 90.0, 270.0)[k - 1])
                c, s = np.cos(turn), np.sin(turn)
                q = posture_beside(place, np.array([[c, -s], [s, c]]) @ hides, self.T_tool0_camera, self.arm_lengths)
                if q is not None:
                    return q
            if k == 1:
                # From straight above, nothing hides behind its neighbours.
                return posture_above(place, k, self.T_tool0_camera, self.arm_lengths)
            k -= 1  # askew, what touches has a jump between, and another side says more of the class than the same one
        return self._look_from[(len(self.log.failures) + k) % len(self._look_from)]

    def _path(
        self, objects: list[SeenObject], view: View | None, q_start: np.ndarray, q_goal: np.ndarray
    ) -> np.ndarray:
        """From one view to another past what was seen; straight where nothing was."""
        if view is None:
            return np.stack([q_start, q_goal])
        seen = np.concatenate([view.obstacles, *(each.points for each in objects)])
        return path_past(seen, view.plane, q_start, q_goal, self.arm_lengths)
