"""One pick with an arm, a gripper and a camera of one's own: the same policy as in simulation, step by step.

Every target is looked up in the workspace before it is sent. After an error nothing more is sent.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real.errors import Declined, MotionTimeout, RobotError
from pecgrasp_env.real.interfaces import Arm, DepthCamera, Motion, ParallelGripper
from pecgrasp_env.real.sight import Sight
from pecgrasp_env.real.workspace import Workspace
from pecgrasp_env.robot.camera_mount import BRACKET, CameraMount
from pecgrasp_env.robot.gripper_linkage import MAX_SPEED

STEP_S = 0.05  # between two actions, as in simulation
_PATIENCE_S = 20.0  # of our clock, for one step
_GRIPPER_S = 0.02  # between two looks whether the gripper is well
_LEAST_CHANGE_M, _LEAST_CHANGE_N = 0.0003, 0.5  # of what the gripper was told last
_LOWEST_GRIPPER_SPEED = 0.03
_LONGEST_STEPS = 4000


class Record(Protocol):
    """Where a run is written down."""

    def frame(self, observation: RobotObservation, frame: DepthFrame) -> None: ...

    def step(self, observation: RobotObservation, action: np.ndarray, doing: str) -> None: ...


class NoRecord:
    """Writes nothing down."""

    def frame(self, observation: RobotObservation, frame: DepthFrame) -> None: ...

    def step(self, observation: RobotObservation, action: np.ndarray, doing: str) -> None: ...


class Records:
    """Several of them at once."""

    def __init__(self, *records: Record) -> None:
        self._records = records

    def frame(self, observation: RobotObservation, frame: DepthFrame) -> None:
        for each in self._records:
            each.frame(observation, frame)

    def step(self, observation: RobotObservation, action: np.ndarray, doing: str) -> None:
        for each in self._records:
            each.step(observation, action, doing)


@dataclass(frozen=True)
class PickOutcome:
    """lifted: something is held, so the policy believes. reason: why not, or None. error: what stopped the arm.

    seconds: of the arm's clock. step_ms: median of our time from one action to the next.
    """

    lifted: bool
    reason: str | None
    error: RobotError | None
    seconds: float
    step_ms: float


class Picker:
    """An arm with its gripper and camera, driven by a policy.

    Args:
        policy: a `ScriptedPolicy` with ``control_dt = STEP_S * speed``.
        speed: share of the simulated robot's speed, 0 … 1.
        ask: called with what comes next, in words; False ends the run.
        mount: where the camera is, from a hand-eye calibration.
    """

    def __init__(
        self,
        arm: Arm,
        gripper: ParallelGripper,
        camera: DepthCamera,
        policy: ScriptedPolicy,
        workspace: Workspace,
        *,
        speed: float = 0.5,
        ask: Callable[[str], bool] | None = None,
        record: Record | None = None,
        mount: CameraMount = BRACKET,
    ) -> None:
        if not 0 < speed <= 1:
            raise ValueError(f"speed={speed}: a share of the simulated robot's, in (0, 1]")
        self._arm, self._gripper = arm, gripper
        self._policy, self._workspace = policy, workspace
        self._speed = speed
        self._ask, self._record = ask, record or NoRecord()
        self._sight = Sight(arm, gripper, camera, mount, self._record.frame)
        self._told: tuple[float, float] | None = None  # opening, m, and force, N, that the gripper was sent to last

    def observe(self) -> RobotObservation:
        """What the policy sees at this moment; the frame is taken when it is looked at."""
        return self._sight.observe()

    def pick(self, target: str) -> PickOutcome:
        """Until the object is up, the policy gives up, the user declines, or something stops the arm."""
        policy = self._policy
        policy.reset(target)
        begun, error, doing = self._arm.state.time, None, ""
        stamps = []
        try:
            for _ in range(_LONGEST_STEPS):
                observation = self.observe()
                action = policy.step(observation)
                self._record.step(observation, action, policy.log.doing)
                if policy.done:
                    break
                if policy.log.doing != doing:
                    doing = policy.log.doing
                    if self._ask is not None and not self._ask_at_rest(doing):
                        raise Declined(f"stopped before {doing!r}, as was wished")
                self._act(action, observation.opening)
                stamps.append(time.perf_counter())
        except RobotError as problem:
            error = problem
            self._halt()
        seconds = self._seconds_since(begun)
        step_ms = 1e3 * float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
        lifted = policy.log.lifted and error is None
        return PickOutcome(lifted, None if lifted else policy.log.reason, error, seconds, step_ms)

    def _ask_at_rest(self, doing: str) -> bool:
        assert self._ask is not None
        self._arm.stop()
        return self._ask(doing)

    def _act(self, action: np.ndarray, measured: float) -> None:
        q, opening, force = action[:6].astype(float), float(action[6]), float(action[7])
        force = min(force, self._workspace.max_force)
        # What stops the fingers keeps them from where they are sent.
        self._workspace.check(q, measured, self._arm.lengths)
        self._grip(opening, force)
        self._wait(self._arm.follow(q, STEP_S))

    def _wait(self, motion: Motion) -> None:
        """Until the arm is there; a fault of the gripper meanwhile ends it, too."""
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            self._gripper.check()
            try:
                return motion.wait(_GRIPPER_S)
            except MotionTimeout:
                if time.monotonic() > deadline:
                    raise

    def _grip(self, opening: float, force: float) -> None:
        told = self._told
        if told is None or abs(opening - told[0]) > _LEAST_CHANGE_M or abs(force - told[1]) > _LEAST_CHANGE_N:
            self._gripper.move(opening, max(_LOWEST_GRIPPER_SPEED, MAX_SPEED * self._speed), force)
            self._told = opening, force

    def _halt(self) -> None:
        """Whatever the error was, the arm is to stand still; where it cannot be told so, it does so by itself."""
        with suppress(RobotError):
            self._arm.stop()

    def _seconds_since(self, begun: float) -> float:
        try:
            return self._arm.state.time - begun
        except RobotError:
            return float("nan")
