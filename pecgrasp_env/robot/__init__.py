"""UR5 + Robotiq 2F-140 + wrist D435: description, kinematics, ManiSkill agent.

The agent is imported when it is first asked for: who plans for a real arm needs no simulator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from pecgrasp_env.robot.kinematics import (
    T_TOOL0_CAMERA,
    T_TOOL0_GRIPPER,
    T_TOOL0_TCP,
    forward_kinematics,
    inverse_kinematics,
    nearest_solution,
    tool0_from_grasp,
    with_turns,
)

if TYPE_CHECKING:
    from pecgrasp_env.robot.agent import UR5Robotiq2F140, gripper_qpos

__all__ = [
    "T_TOOL0_CAMERA",
    "T_TOOL0_GRIPPER",
    "T_TOOL0_TCP",
    "UR5Robotiq2F140",
    "forward_kinematics",
    "gripper_qpos",
    "inverse_kinematics",
    "nearest_solution",
    "tool0_from_grasp",
    "with_turns",
]


def __getattr__(name: str) -> Any:
    if name in ("UR5Robotiq2F140", "gripper_qpos"):
        from pecgrasp_env.robot import agent

        return getattr(agent, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
