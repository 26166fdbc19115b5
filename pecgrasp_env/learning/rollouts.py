"""How well an agent does that sees the state and acts in `pd_joint_pos`, and two agents that do not try.

An agent is a callable: observation of the mode `state_dict`, batched with one sub-environment → action (8,).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from torch.utils.tensorboard import SummaryWriter

from pec.metrics.proportions import wilson_interval
from pecgrasp_env.robot.gripper_linkage import STROKE

Act = Callable[[Mapping[str, Any]], np.ndarray]


def idling() -> Act:
    """The arm stays where it is, the gripper open."""
    return lambda obs: _action(obs, np.zeros(6), STROKE)


def acting_at_random(rng: np.random.Generator) -> Act:
    """Each joint up to 0.1 rad from where it is, and any opening."""
    return lambda obs: _action(obs, rng.uniform(-0.1, 0.1, 6), rng.uniform(0.0, STROKE))


def _action(obs: Mapping[str, Any], step: np.ndarray, opening: float) -> np.ndarray:
    return np.array([*(np.asarray(obs["agent"]["qpos"])[0, :6] + step), opening, 60.0], np.float32)


def evaluate(env: gym.Env, agent: Callable[[], Act], seeds: Sequence[int], most_steps: int) -> dict[str, Any]:
    """Episodes of at most ``most_steps``, one a seed, each with a new agent.

    success, held (an asked-for object was between both pads at some step): count, share and Wilson interval, 95 %.
    return: mean of the dense reward's sum, and its standard error. closest_m: median of the least distance from the
    pads' centre to the object.
    """
    succeeded, held, returns, closest = 0, 0, [], []
    for seed in seeds:
        obs, info = env.reset(seed=seed)
        act, was_held, total, distance = agent(), False, 0.0, float(info["target_distance"])
        for _ in range(most_steps):
            obs, reward, terminated, _, info = env.step(act(obs))
            total += float(reward)
            was_held |= bool(info["target_held"])
            distance = min(distance, float(info["target_distance"]))
            if bool(terminated):
                break
        succeeded += bool(info["success"])
        held += was_held
        returns.append(total)
        closest.append(distance)
    n = len(returns)
    return {
        "success": {"count": succeeded, "share": succeeded / n, "interval": list(wilson_interval(succeeded, n))},
        "held": {"count": held, "share": held / n, "interval": list(wilson_interval(held, n))},
        "return": {"mean": float(np.mean(returns)), "standard_error": float(np.std(returns) / np.sqrt(n))},
        "closest_m": float(np.median(closest)),
        "episodes": n,
    }


def show(writer: SummaryWriter, measured: Mapping[str, Any], epoch: int) -> None:
    """What `evaluate` has measured, in TensorBoard."""
    for name in ("success", "held"):
        low, high = measured[name]["interval"]
        for suffix, value in (("", measured[name]["share"]), ("_low", low), ("_high", high)):
            writer.add_scalar(f"episodes/{name}{suffix}", value, epoch)
    writer.add_scalar("episodes/return", measured["return"]["mean"], epoch)
    writer.add_scalar("episodes/closest_m", measured["closest_m"], epoch)
