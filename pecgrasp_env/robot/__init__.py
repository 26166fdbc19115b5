"""UR5 + Robotiq 2F-140 + wrist D435: description, ManiSkill agent, kinematics."""

from pecgrasp_env.robot.agent import UR5Robotiq2F140, gripper_qpos
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
