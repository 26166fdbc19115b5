"""The same episodes as a real arm would have them: the policy through `ur_rtde` and real sockets, step by step as
`pecgrasp pick` drives it, against a stand-in whose arm, gripper and camera are those of the simulated scene.
"""

from __future__ import annotations

import shutil
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pecgrasp_env.common.outcomes import RIGHT
from pecgrasp_env.envs.registration import MAX_EPISODE_STEPS
from pecgrasp_env.evaluation.episode import Episode, episode_of
from pecgrasp_env.policy.observation import RobotObservation
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real.errors import Declined
from pecgrasp_env.real.fakes.bench import BenchCamera
from pecgrasp_env.real.fakes.own_process import StandIn
from pecgrasp_env.real.pick import NoRecord, Picker, PickOutcome, Records
from pecgrasp_env.real.pick_page import write_pick_page
from pecgrasp_env.real.pick_record import PickRecord
from pecgrasp_env.real.robotiq import RobotiqGripper
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.real.workspace import Workspace

if TYPE_CHECKING:
    from pecgrasp_env.envs.simulated_robot import SimulatedRobot

_PATIENCE_S = 60.0  # a busy machine is no lost connection
_SETTLING_S = 1.0  # of the arm's clock, as in the simulation alone
_OUT_OF_TIME = "out of time"


class SocketRunner:
    """A stand-in in a process of its own, and a policy that picks through its sockets, for one episode after another.

    Args:
        policy: a `ScriptedPolicy` of the simulated robot's full speed.
        env: keyword arguments of SelectiveGrasp-v1, without ``absent``: no real arm gives that answer.
        pace: simulated seconds a second, at most.
        pictures: where a folder as `pecgrasp pick` leaves it is kept of each episode that failed, or None.
    """

    def __init__(self, policy: ScriptedPolicy, env: dict[str, Any], pace: float, pictures: Path | None) -> None:
        self._policy, self._pictures = policy, pictures
        self._most_steps = int(env.get("max_episode_steps") or MAX_EPISODE_STEPS)
        self._stand_in = StandIn(partial(simulated_robot, env), pace)
        self._host, self._bench = self._stand_in.host, self._stand_in.bench
        self._camera = BenchCamera(self._host)

    def run(self, seed: int) -> Episode:
        """Raises RobotError where a socket fails; what stops the arm is the episode's outcome."""
        self._bench.ask(reset=seed)
        target = self._bench.state["target"]
        folder = None if self._pictures is None else self._pictures / str(seed)
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
        record = None if folder is None else PickRecord(folder, {"target": target, "seed": seed})
        steps = _Steps(self._most_steps)
        arm = URArm(self._host, speed=1.0, patience=_PATIENCE_S)
        try:
            gripper = RobotiqGripper(self._host)
            try:
                both = Records(steps) if record is None else Records(steps, record)
                picker = Picker(arm, gripper, self._camera, self._policy, Workspace(), speed=1.0, record=both)
                ended = picker.pick(target)
                self._settle()
            finally:
                gripper.close()
        finally:
            arm.close()
        episode = self._episode(seed, ended, steps.count)
        if record is not None and folder is not None:
            record.ended(ended, self._policy)
            if episode.outcome in RIGHT:
                shutil.rmtree(folder)
            else:
                write_pick_page(folder, self._policy, target)
        return episode

    def close(self) -> None:
        """End the stand-in."""
        self._camera.close()
        self._stand_in.close()

    def _settle(self) -> None:
        """What is held must come to rest, or fall."""
        end = self._bench.state["time"] + _SETTLING_S
        while (state := self._bench.state)["time"] < end and state["outcome"] is None:
            time.sleep(0.02)

    def _episode(self, seed: int, ended: PickOutcome, steps: int) -> Episode:
        state, log = self._bench.state, self._policy.log
        judged, error = state["judged"], ended.error
        episode = episode_of(seed, state["target"], state["instances"], steps, judged, log)
        if isinstance(error, Declined):
            return episode if episode.outcome in RIGHT else replace(episode, outcome="timeout")
        if error is not None:
            return replace(episode, outcome="error", reason=f"{type(error).__name__}: {error}")
        return episode


class _Steps(NoRecord):
    """Ends a pick after as many steps as an episode has."""

    def __init__(self, most: int) -> None:
        self.count, self._most = 0, most

    def step(self, observation: RobotObservation, action: np.ndarray, doing: str) -> None:
        self.count += 1
        if self.count > self._most:
            raise Declined(_OUT_OF_TIME)


def simulated_robot(env: dict[str, Any]) -> SimulatedRobot:
    """The scene and its robot, for a process that has nothing else to do."""
    import torch

    from pecgrasp_env.envs.simulated_robot import SimulatedRobot

    torch.set_num_threads(1)
    return SimulatedRobot(**({"render_backend": "cpu"} | env))
