"""The dense reward: differences of a potential, so that nothing can be earned twice.

What is gained on the way to a state is lost on the way back (Ng, Harada and Russell 1999, with a discount of 1): the
sum over an episode depends on how far it got and how it ended, not on how long it took. Idling beside the object,
shaking it, or grasping and letting go again and again therefore earns nothing.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch

from pecgrasp_env.envs.task_state import LIFT_HEIGHT

SUCCESS = 5.0
FAILURE = -1.0


def reach(distance: torch.Tensor) -> torch.Tensor:
    """1 at the object, 0 far from it; distance between the pads' centre and the object's, m."""
    return 1 - torch.tanh(5 * distance)


def potential(info: Mapping[str, torch.Tensor]) -> torch.Tensor:
    """How far the task has got, (N,), between -1 and 4.

    info: the task's, whose ``target_distance`` is that from the pads' centre to the nearest asked-for object.
    """
    held = info["target_held"].float()
    lift = (info["target_air"] / LIFT_HEIGHT).clamp(0, 1)
    still = (1 - torch.tanh(10 * info["target_speed"])) * (info["target_air"] >= LIFT_HEIGHT)
    return reach(info["target_distance"]) + held * (1 + lift + still) - info["wrong_held"].float()


def reward(before: torch.Tensor, after: torch.Tensor, info: Mapping[str, torch.Tensor]) -> torch.Tensor:
    """The reward of a control step, (N,), from the potentials before and after it."""
    progress = torch.where(info["success"], torch.full_like(after, SUCCESS), after - before)
    return progress + FAILURE * info["fail"].float()
