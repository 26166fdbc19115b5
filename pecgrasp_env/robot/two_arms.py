"""Two UR5 with their grippers as one agent whose action is one vector, as that of one arm is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from mani_skill.agents.multi_agent import MultiAgent

from pecgrasp_env.robot.agent import UR5Robotiq2F140
from pecgrasp_env.robot.two_arm_bases import ARMS


class TwoArms(MultiAgent):
    """arms: the two, each in the frame of its own base. Action (16,): the first arm's eight numbers, then the second's.

    The cameras on the hands are there, but show nothing.
    """

    def __init__(self, arms: Sequence[UR5Robotiq2F140]) -> None:
        super().__init__(list(arms))
        self.arms = tuple(arms)
        self.agents_dict = dict(zip(ARMS, arms, strict=True))
        self.sensor_configs: list[Any] = []

    @property
    def single_action_space(self) -> spaces.Box:
        one, other = (arm.single_action_space for arm in self.arms)
        return spaces.Box(
            np.concatenate([one.low, other.low]), np.concatenate([one.high, other.high]), dtype=np.float32
        )

    @property
    def action_space(self) -> spaces.Box:
        single = self.single_action_space
        return single if self.scene.num_envs == 1 else batch_space(single, n=self.scene.num_envs)

    def set_action(self, action: torch.Tensor) -> None:
        """action: (num_envs, 16). Raises ValueError where it is not finite (CPU only)."""
        for arm, part in zip(self.arms, action.chunk(2, dim=1), strict=True):
            arm.set_action(part)

    def before_simulation_step(self) -> None:
        for arm in self.arms:
            arm.before_simulation_step()

    def get_proprioception(self) -> dict[str, Any]:
        return {name: arm.get_proprioception() for name, arm in self.agents_dict.items()}
