"""When the gripper's pads press on something: with enough force, and along the closing axis."""

from __future__ import annotations

import numpy as np
import torch
from mani_skill.utils.structs import Link

MIN_FORCE_N = 0.5
MAX_ANGLE_DEG = 85.0  # between a pad's force and the closing axis


def outward(left_finger: Link) -> torch.Tensor:
    """Unit vector (num_envs, 2, 3), world frame, in which an object between the pads presses on each: left, right."""
    closing = left_finger.pose.to_transformation_matrix()[..., :3, 1]  # the left finger is on -y
    return torch.stack([-closing, closing], dim=1)


def both_press(
    forces: torch.Tensor, directions: torch.Tensor, min_force: float = MIN_FORCE_N, max_angle: float = MAX_ANGLE_DEG
) -> torch.Tensor:
    """Whether both pads press on each of K things, (num_envs, K) bool.

    Args:
        forces: (num_envs, 2, K, 3) N, by each thing on the left and the right pad.
        directions: (num_envs, 2, 3), of `outward`.
        min_force: N, least force on each pad. max_angle: degrees between it and the pad's direction.
    """
    return _press(forces, directions, min_force, max_angle).all(dim=1)


def held_between(
    forces: torch.Tensor, directions: torch.Tensor, min_force: float = MIN_FORCE_N, max_angle: float = MAX_ANGLE_DEG
) -> torch.Tensor:
    """Which of K things the pads hold, (num_envs, K) bool, be it several at once: what presses on either pad while
    something presses on the other. Arguments as of `both_press`.
    """
    press = _press(forces, directions, min_force, max_angle)
    return press.any(dim=1) & press.any(dim=2).all(dim=1, keepdim=True)


def _press(forces: torch.Tensor, directions: torch.Tensor, min_force: float, max_angle: float) -> torch.Tensor:
    """(num_envs, 2, K) bool: which things press on which pad."""
    size = torch.linalg.norm(forces, dim=3)
    along = (forces * directions[:, :, None]).sum(dim=3)
    return (size >= min_force) & (along >= float(np.cos(np.radians(max_angle))) * size)
