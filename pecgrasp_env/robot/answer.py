"""What the robot may say beside what it does: that the class that is asked for is not there.

ManiSkill's actions belong to controllers, so the answer is one that moves nothing: in every control mode the ninth
number of the action, in [-1, 1], and above `SAYS_ABSENT` it is said.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from mani_skill.agents.controllers.base_controller import BaseController, ControllerConfig

from pecgrasp_env.robot.agent import UR5Robotiq2F140

SAYS_ABSENT = 0.5


class AnswerController(BaseController):
    """Action (1,) in [-1, 1]. said_absent: (num_envs,) bool, whether the last action said so."""

    sets_target_qpos = False
    sets_target_qvel = False

    def _initialize_joints(self) -> None:
        self.joints: list[Any] = []
        self.active_joint_indices = torch.zeros(0, dtype=torch.long, device=self.device)
        self.said_absent = torch.zeros(self.scene.num_envs, dtype=torch.bool, device=self.device)

    def _initialize_action_space(self) -> None:
        self.single_action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)

    def set_drive_property(self) -> None:
        pass

    def reset(self) -> None:
        self.said_absent[self.scene._reset_mask] = False

    def set_action(self, action: torch.Tensor) -> None:
        self.said_absent = self._preprocess_action(action)[:, 0] > SAYS_ABSENT


@dataclass
class AnswerControllerConfig(ControllerConfig):
    """`joint_names`: none."""

    controller_cls = AnswerController


class AnsweringUR5Robotiq2F140(UR5Robotiq2F140):
    """The same robot, which can answer, too: actions (9,). said_absent: as of `AnswerController`."""

    @property
    def _controller_configs(self) -> dict[str, Any]:
        moving = super()._controller_configs
        return {mode: {**parts, "answer": AnswerControllerConfig([])} for mode, parts in moving.items()}

    @property
    def said_absent(self) -> torch.Tensor:
        said: torch.Tensor = self.controller.controllers["answer"].said_absent
        return said
