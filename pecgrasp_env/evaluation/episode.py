"""One episode of SelectiveGrasp-v1 under a policy: how it ended, and why."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import gymnasium as gym
import numpy as np

from pecgrasp_env.envs.selective_grasp import SelectiveGraspEnv
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.pick_planner import NOT_FOUND

_SETTLING_STEPS = 20  # after the policy is done: what it holds must come to rest, or fall


@dataclass(frozen=True)
class Episode:
    """One episode.

    outcome: one of OUTCOMES. reason: what the policy said when it gave up, or the error. failures: why each try failed
    that did.
    objects: the instances on the table. confidence: probability of the asked-for class of the object that was chosen
    last. stages: seconds of computing, by stage, one number a call.
    disturbance_m: how far the object that was moved most, of those not asked for, was moved; None where there is none.
    visible_share: of the asked-for object at the start, None where there is none or that was not noted. cleared: how
    many objects were taken off it and put down. doubts: what the policy was unsure of.
    """

    seed: int
    target: str
    outcome: str
    reason: str | None
    failures: list[str]
    steps: int
    views: int
    confidence: float
    objects: list[str]
    stages: dict[str, list[float]]
    disturbance_m: float | None = None
    visible_share: float | None = None
    cleared: int = 0
    doubts: list[str] = field(default_factory=list)


class Policy(Protocol):
    """What `ScriptedPolicy` does, and whatever looks at one."""

    @property
    def log(self) -> PolicyLog: ...

    @property
    def done(self) -> bool: ...

    def reset(self, target: str) -> None: ...

    def act(self, obs: Mapping[str, Any]) -> np.ndarray: ...


def run_episode(env: gym.Env, policy: Policy, seed: int, on_step: Callable[[Any], None] | None = None) -> Episode:
    """One episode of SelectiveGrasp-v1 (one sub-environment, control mode `pd_joint_pos`, an obs_mode with depth).

    policy: a `ScriptedPolicy` with ``answers`` where the task has ``absent``.
    on_step: called with the environment after every step, to record pictures.
    """
    task: SelectiveGraspEnv = env.unwrapped
    obs, info = env.reset(seed=seed)
    policy.reset(info["target"][0])
    after = 0
    truncated = False
    while after < _SETTLING_STEPS and not truncated:
        action = policy.act(obs)
        if policy.log.reason is not None:
            task.set_planner_reason(policy.log.reason)
        obs, _, terminated, time_out, info = env.step(action)
        if on_step is not None:
            on_step(env)
        if bool(terminated):
            break
        truncated = bool(time_out)
        after += policy.done
    instances = [model.instance for model in task.models[0]]
    return episode_of(seed, task.target_names[0], instances, int(info["elapsed_steps"]), info, policy.log)


def episode_of(
    seed: int, target: str, instances: list[str], steps: int, info: Mapping[str, Any], log: PolicyLog
) -> Episode:
    """What came of it, from what the task (`info`) and the policy say at the end. instances: what lay there."""
    absent = bool(info.get("absent", False))
    return Episode(
        seed=seed,
        target=target,
        outcome=_outcome(info, log),
        reason=log.reason,
        failures=list(log.failures),
        steps=steps,
        views=log.views,
        confidence=log.confidence,
        objects=instances,
        stages={name: [round(each, 6) for each in seconds] for name, seconds in log.stages.items()},
        disturbance_m=round(float(info["disturbance_m"]), 6) if len(instances) > 1 else None,
        visible_share=None if absent else round(float(info["visible_share"]), 6),
        cleared=log.cleared,
        doubts=list(log.doubts),
    )


def _outcome(info: Mapping[str, Any], log: PolicyLog) -> str:
    """One of OUTCOMES, from what the task and the policy say at the end."""
    if bool(info.get("stranger_lifted", False)):
        return "stranger"
    if bool(info.get("said_absent", False)) and not bool(info["wrong_object"] or info["off_table"]):
        return "absent" if bool(info["absent"]) else "denied"
    for name in ("success", "wrong_object", "off_table", "dropped"):
        if bool(info[name]):
            return name
    if log.reason is None:
        return "missed" if log.lifted else "timeout"  # lifted: the policy believes that it holds the object high enough
    if log.reason == NOT_FOUND:
        return "no_object"
    return "no_grasp" if log.reason.startswith("no ") else "missed"
