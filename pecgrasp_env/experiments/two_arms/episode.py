"""One episode of DualGrasp-v1 under a `TwoArmPolicy`: whether the thing came level to where it should, and why not."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from pecgrasp_env.envs.dual.dual_grasp import DualGraspEnv
from pecgrasp_env.policy.two_arms.scripted import TwoArmPolicy

# What each outcome is called, and its tone.
OUTCOME_WORDS = {
    "carried": ("carried level", "good"),
    "overloaded": ("too heavy for one arm", "bad"),
    "tilted": ("tilted by 10 degrees", "bad"),
    "off_table": ("pushed off the table", "bad"),
    "no_grasps": ("no grasps found", "warn"),
    "not_held": ("not held", "warn"),
    "timeout": ("out of time", "warn"),
    "error": ("program error", "bad"),
}
_SETTLING_STEPS = 20  # after the policy is done: what it holds must come to rest, or fall


@dataclass(frozen=True)
class DualEpisode:
    """One episode.

    outcome: one of OUTCOME_WORDS; "overloaded" also where the simulated arms carried it level all the same, which is
    `level`. object, kind, mass [kg]: of the thing. worst_tilt: degrees. most_load: N that a hand bore, at its most.
    centre_error: m, seen from above, of the centre of mass as it was estimated; None where a method estimates none.
    reason: why the policy gave up, or the error. failures: why choices before that had no motion. seconds: of computing
    in the policy.
    """

    seed: int
    method: str
    outcome: str
    level: bool
    object: str
    kind: str
    mass: float
    worst_tilt: float
    most_load: float
    centre_error: float | None
    reason: str | None
    failures: list[str]
    steps: int
    seconds: float


def run_dual_episode(
    env: gym.Env, policy: TwoArmPolicy, seed: int, on_step: Callable[[Any], None] | None = None
) -> DualEpisode:
    """One episode of DualGrasp-v1 (control mode `pd_joint_pos`, an obs_mode with depth, no protective stop).

    on_step: called with the environment after every step, to record pictures.
    """
    task: DualGraspEnv = env.unwrapped
    obs, info = env.reset(seed=seed)
    centre = info["centre_of_mass"][0].numpy().astype(float)
    policy.reset(seed)
    after, truncated, seconds, most = 0, False, 0.0, 0.0
    while after < _SETTLING_STEPS and not truncated:
        start = time.process_time()
        action = policy.act(obs)
        seconds += time.process_time() - start
        if policy.log.reason is not None:
            task.set_planner_reason(policy.log.reason)
        obs, _, terminated, time_out, info = env.step(action)
        most = max(most, float(info["loads"].max()))
        if on_step is not None:
            on_step(env)
        if bool(terminated):
            break
        truncated = bool(time_out)
        after += policy.done
        if policy.log.arrived and bool(info["carried_level"]):
            break
    log, error = policy.log, None
    if log.choice is not None and log.choice.centre is not None:
        error = round(float(np.linalg.norm((log.choice.centre - centre)[:2])), 5)
    return DualEpisode(
        seed=seed,
        method=policy.method,
        outcome=_outcome(info, policy),
        level=bool(info["carried_level"]),
        object=task.model.instance,
        kind=task.model.class_name,
        mass=round(task.model.mass, 4),
        worst_tilt=round(float(np.degrees(float(info["worst_tilt"]))), 3),
        most_load=round(most, 2),
        centre_error=error,
        reason=log.reason,
        failures=list(log.failures),
        steps=int(info["elapsed_steps"]),
        seconds=round(seconds, 3),
    )


def _outcome(info: dict[str, Any], policy: TwoArmPolicy) -> str:
    if bool(info["carried_level"]):
        return "overloaded" if bool(info["overloaded"]) else "carried"
    for name in ("off_table", "tilted"):
        if bool(info[name]):
            return name
    if policy.log.reason is None and not policy.log.arrived:
        return "timeout"
    return "no_grasps" if policy.log.holds is None else "not_held"
