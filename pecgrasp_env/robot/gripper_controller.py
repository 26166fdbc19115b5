"""The 2F-140's controller: commanded in metres of opening and newtons of grip force, as the real gripper is.

Both cranks get one position target. Three things make that behave like the gripper's own motor:
- the target travels at no more than 250 mm/s (a joint speed limit in the solver would cut the squeeze force);
- the drives' torque limit follows from the force by virtual work, tau = F · 0.1 m · cos(theta), at the measured angle;
- the target runs at most `LEAD` ahead of the fingers, so that a gripper stopped by an object opens again at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from gymnasium import spaces
from mani_skill.agents.controllers.base_controller import BaseController, ControllerConfig

from pecgrasp_env.robot import gripper_linkage as lk

STIFFNESS, DAMPING = 1000.0, 30.0  # N·m/rad, N·m·s/rad of each crank's drive
LEAD = 0.025  # m: twice a control step at full speed, so that the lead never slows the fingers


def opening_of(crank_joint: torch.Tensor) -> torch.Tensor:
    """`linkage.opening` for tensors of any shape: opening (m) at crank joint angles (rad)."""
    return 2 * lk.CRANK_LENGTH * torch.sin(lk.CRANK_REST - crank_joint) + lk._GAP_AT_ZERO


def crank_joint_of(opening: torch.Tensor) -> torch.Tensor:
    """`linkage.crank_joint` for tensors of any shape: crank joint angle (rad) at openings (m)."""
    return lk.CRANK_REST - torch.asin((opening - lk._GAP_AT_ZERO) / (2 * lk.CRANK_LENGTH))


class GripperController(BaseController):
    """Action (2,): opening between the pads, m, 0 … 0.140, and force limit, N, 10 … 125.

    With `normalize_action` both are in [-1, 1], mapped linearly on these ranges. Values outside are clipped.
    """

    config: GripperControllerConfig
    sets_target_qpos = True
    sets_target_qvel = False

    def _initialize_action_space(self) -> None:
        low, high = np.array([0.0, lk.MIN_FORCE]), np.array([lk.STROKE, lk.MAX_FORCE])
        self.single_action_space = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        self._low = torch.tensor(low, dtype=torch.float32, device=self.device)
        self._high = torch.tensor(high, dtype=torch.float32, device=self.device)
        self._target = torch.full((self.scene.num_envs,), lk.STROKE, device=self.device)
        self._force = torch.full((self.scene.num_envs,), lk.MAX_FORCE, device=self.device)

    @property
    def opening(self) -> torch.Tensor:
        """Measured opening (num_envs,), m."""
        return opening_of(self.qpos.mean(dim=-1))

    def set_drive_property(self) -> None:
        for joint in self.joints:
            joint.set_friction(0.0)
        self._set_force_limit()

    def reset(self) -> None:
        """Let the fingers rest where they are, in the environments being reset."""
        mask = self.scene._reset_mask
        self._target[mask] = self.opening[mask]
        self._force[mask] = lk.MAX_FORCE
        self._set_force_limit()
        self._set_target()

    def set_action(self, action: torch.Tensor) -> None:
        action = torch.clamp(self._preprocess_action(action), self._low, self._high)
        measured = self.opening
        start = torch.clamp(self._target, measured - LEAD, measured + LEAD)
        stride = lk.MAX_SPEED / self._control_freq
        self._target = start + torch.clamp(action[:, 0] - start, -stride, stride)
        self._force = action[:, 1]
        self._set_force_limit()
        self._set_target()

    def get_state(self) -> dict[str, torch.Tensor]:
        return {"target_opening": self._target[:, None], "force_limit": self._force[:, None]}

    def set_state(self, state: dict[str, torch.Tensor]) -> None:
        self._target = state["target_opening"][:, 0].clone()
        self._force = state["force_limit"][:, 0].clone()

    def _set_target(self) -> None:
        joint_target = crank_joint_of(self._target)
        targets = torch.stack([joint_target, joint_target], dim=-1)
        self.articulation.set_joint_drive_targets(targets, self.joints, self.active_joint_indices)

    def _set_force_limit(self) -> None:
        theta = lk.CRANK_REST - self.qpos.mean(dim=-1)
        limits = (self._force * lk.CRANK_LENGTH * torch.cos(theta)).tolist()
        for joint in self.joints:
            for physx_joint, limit in zip(joint._objs, limits, strict=True):
                physx_joint.set_drive_properties(STIFFNESS, DAMPING, limit, "force")


@dataclass
class GripperControllerConfig(ControllerConfig):
    """`joint_names`: the two cranks. `normalize_action`: take [-1, 1] instead of metres and newtons."""

    normalize_action: bool = False
    controller_cls = GripperController
