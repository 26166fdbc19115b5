"""A scripted policy for DualGrasp-v1: look, choose, approach one after the other, close both, lift and carry in step.

As `ScriptedPolicy` it is one generator, read from the top: each ``yield`` is one control step. Actions are those of the
control mode `pd_joint_pos`, the first arm's and then the second's.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from grasping import Segmenter
from pecgrasp_env.motion.grasp_approach import Approach
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.motion.two_arms import carry, plan_approaches
from pecgrasp_env.policy.arm_primitives import ArmSteps, Steps
from pecgrasp_env.policy.holding import is_held
from pecgrasp_env.policy.two_arms.choices import METHODS, Choice, Holds
from pecgrasp_env.policy.two_arms.looking import DualObservation, Seen, look, read_dual_observation
from pecgrasp_env.robot.gripper_linkage import MAX_FORCE
from pecgrasp_env.robot.two_arm_bases import ARMS

DualSteps = Generator[np.ndarray, DualObservation, Any]

FORCE_N = MAX_FORCE  # what it weighs is not known, and it is up to 6 kg
LARGEST_M = 1.2  # extent of what may lie there
_APPROACH_SPEED = 0.5
_TRIED = 8  # choices whose motion is planned
_HOLDING_STEPS = 4


@dataclass
class DualLog:
    """What happened in an episode. doing: in words, for captions. seen: what it saw. choice: what it may try. holds:
    what it tries. failures: why choices before that have no motion. reason: why it gave up, or None. arrived: it is
    where it was to carry the thing.
    """

    doing: str = ""
    seen: Seen | None = None
    choice: Choice | None = None
    holds: Holds | None = None
    failures: list[str] = field(default_factory=list)
    reason: str | None = None
    arrived: bool = False


class TwoArmPolicy:
    """Carries out what a method of `choices.METHODS` chooses.

    Args:
        method: "pair", "single" or "random".
        control_dt: seconds between two calls of `act`.

    Raises ValueError for a method that there is not.
    """

    def __init__(self, method: str = "pair", *, control_dt: float = 0.05) -> None:
        if method not in METHODS:
            raise ValueError(f"method={method!r}: must be one of {', '.join(METHODS)}")
        self.method = method
        self._choose = METHODS[method]
        self._segmenter = Segmenter(max_extent=LARGEST_M)
        self._control_dt = control_dt
        self.log = DualLog()
        self._steps: DualSteps | None = None
        self._seed = 0
        self._arms: tuple[ArmSteps, ArmSteps]

    def reset(self, seed: int = 0) -> None:
        """Begin an episode. seed: of what a method draws."""
        self.log = DualLog()
        self._seed, self._steps = seed, None

    @property
    def done(self) -> bool:
        """Whether it is there or has given up; it then holds still."""
        return self.log.arrived or self.log.reason is not None

    def act(self, obs: Mapping[str, Any]) -> np.ndarray:
        """The next action (16,) float32 for an observation with depth. Raises ObservationError."""
        observation = read_dual_observation(obs)
        if self._steps is None:
            first, second = (ArmSteps(arm, self._control_dt, FORCE_N) for arm in observation.arms)
            self._arms = first, second
            self._steps = self._episode(observation)
            return self._first(self._steps)
        try:
            return self._steps.send(observation)
        except StopIteration:
            return self._command

    def _first(self, steps: DualSteps) -> np.ndarray:
        try:
            return next(steps)
        except StopIteration:
            return self._command

    @property
    def _command(self) -> np.ndarray:
        return np.concatenate([arm.command for arm in self._arms])

    def _episode(self, observation: DualObservation) -> DualSteps:
        log = self.log
        log.doing = "looking"
        log.seen = look(observation, self._segmenter)
        if log.seen is None:
            return self._give_up("nothing was seen on the table")
        log.choice = self._choose(log.seen, observation.goal, np.random.default_rng(self._seed))
        approaches = self._with_motion(log.seen, log.choice, observation)
        if approaches is None:
            why = log.choice.reason or f"no motion: {log.failures[0] if log.failures else 'nothing to try'}"
            return self._give_up(why)
        for arm, approach in approaches.items():
            log.doing = f"{_name(arm)}: moving over its grasp"
            steps = self._arms[arm].go(approach.to_pregrasp, observation.arms[arm], opening=approach.opening)
            observation = yield from self._together({arm: steps}, observation)
            log.doing = f"{_name(arm)}: coming down"
            steps = self._arms[arm].go(
                approach.to_grasp,
                observation.arms[arm],
                opening=approach.opening,
                speed=_APPROACH_SPEED,
                careful=True,
            )
            observation = yield from self._together({arm: steps}, observation)
            if self._arms[arm].blocked(observation.arms[arm], approach.opening):
                return self._give_up(f"{_name(arm)} touched something on the way down")
        log.doing = "closing"
        closing = {k: self._arms[k].close(observation.arms[k], each.posture_at) for k, each in approaches.items()}
        observation = yield from self._together(closing, observation)
        squeezing = {k: self._arms[k].squeeze(observation.arms[k]) for k in approaches}
        observation = yield from self._together(squeezing, observation)
        for k in approaches:
            if not _holds(observation, k):
                return self._give_up(f"{_name(k)} closed on nothing")
        log.doing = "lifting and carrying it" + (" in step" if len(approaches) == 2 else "")
        postures = {k: self._arms[k].command[:6].astype(float) for k in range(2)}
        try:
            targets = carry(postures, tuple(approaches), observation.goal, self._control_dt)
        except MotionError as error:
            return self._give_up(f"no way to carry it: {error}")
        for q in targets:
            for k in approaches:
                self._arms[k].command[:6] = q[k]
            observation = yield self._command
        for _ in range(_HOLDING_STEPS):
            observation = yield self._command
        lost = [_name(k) for k in approaches if not _holds(observation, k)]
        if lost:
            return self._give_up(f"{' and '.join(lost)} lost it")
        log.doing, log.arrived = "holding it", True
        return None

    def _with_motion(self, seen: Seen, choice: Choice, observation: DualObservation) -> dict[int, Approach] | None:
        """The paths of the first choice that the arms can carry out."""
        q_now = np.array([arm.q for arm in observation.arms])
        for holds in choice.holds[:_TRIED]:
            try:
                approaches = plan_approaches(holds, seen.points, seen.plane, q_now, observation.goal)
            except MotionError as error:
                self.log.failures.append(str(error))
                continue
            self.log.holds = holds
            return approaches
        return None

    def _together(self, steps: Mapping[int, Steps], observation: DualObservation) -> DualSteps:
        """Movements of one arm or both at the same time; an arm that has nothing to do holds still."""
        running = {}
        for arm, each in steps.items():
            try:
                next(each)
            except StopIteration:
                continue
            running[arm] = each
        while running:
            observation = yield self._command
            for arm in list(running):
                try:
                    running[arm].send(observation.arms[arm])
                except StopIteration:
                    del running[arm]
        return observation

    def _give_up(self, reason: str) -> None:
        self.log.reason = reason
        self.log.doing = f"gave up: {reason}"


def _name(arm: int) -> str:
    return ARMS[arm].replace("_", " ")


def _holds(observation: DualObservation, arm: int) -> bool:
    """Whether opening and force of the gripper say so, as on the real one."""
    seen = observation.arms[arm]
    return is_held(seen.opening, seen.force)
