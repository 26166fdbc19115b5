"""A policy that is looked at while it works: what it saw when it planned, or when it looked last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasping import GraspPlan
from pecgrasp_env.evaluation.episode import Policy
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.observation import RobotObservation, read_observation
from pecgrasp_env.policy.seen_objects import SeenObject


@dataclass(frozen=True)
class Sight:
    """What the policy had before it when it planned, or looked last. objects, plan: in the robot's base frame."""

    observation: RobotObservation
    objects: list[SeenObject]
    chosen: int | None = None
    plan: GraspPlan | None = None


class Watched:
    """Does what the policy does. observation: the last one."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.sight: Sight | None = None
        self.observation: RobotObservation | None = None

    @property
    def log(self) -> PolicyLog:
        return self._policy.log

    @property
    def done(self) -> bool:
        return self._policy.done

    def reset(self, target: str) -> None:
        self._policy.reset(target)
        self.sight = self.observation = None

    def act(self, obs: Mapping[str, Any]) -> np.ndarray:
        views, plan = self.log.views, self.log.plan
        action = self._policy.act(obs)
        log = self.log
        self.observation = observation = read_observation(obs)
        if log.plan is not plan:
            self.sight = Sight(observation, list(log.objects), log.chosen, log.plan)
        elif log.views != views and (self.sight is None or self.sight.plan is None):
            self.sight = Sight(observation, list(log.objects))
        return action
