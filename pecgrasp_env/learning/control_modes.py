"""Actions of one control mode as those of another that move the robot the same way, from where it is.

Between them stand the actions of `pd_joint_pos`: joint targets (6,), rad, opening, m, and force limit, N.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot.gripper_linkage import MAX_FORCE, MIN_FORCE, STROKE
from pecgrasp_env.robot.kinematics import T_TOOL0_TCP, forward_kinematics

CONTROL_MODES = ("pd_joint_pos", "pd_joint_delta_pos", "pd_ee_pose", "pd_ee_delta_pose")
_STEP = 0.1  # of ±1 in the modes with delta: rad of a joint or of the tool, m of the tool
_GRIPPER_LOW, _GRIPPER_HIGH = np.array([0.0, MIN_FORCE]), np.array([STROKE, MAX_FORCE])


def from_joint_targets(agent: Any, action: np.ndarray) -> np.ndarray:
    """The action (8,) float32 in the control mode of ``agent``, a `UR5Robotiq2F140`, that takes it towards the same
    posture as ``action`` (8,) of `pd_joint_pos`, as far as a step of that mode goes. With a ninth number, the answer,
    that stays.
    """
    q, gripper, answer = np.asarray(action[:6], float), np.asarray(action[6:8], float), np.asarray(action[8:], float)
    mode = agent.control_mode
    if mode == "pd_joint_pos":
        arm = q
    elif mode == "pd_joint_delta_pos":
        arm = np.clip((q - _joints(agent)) / _STEP, -1, 1)
    else:
        T_target = forward_kinematics(q) @ T_TOOL0_TCP
        turn = Rotation.from_matrix(T_target[:3, :3])
        if mode == "pd_ee_delta_pose":
            T_now = agent.tcp.pose.to_transformation_matrix()[0].cpu().numpy().astype(float)
            move = (T_target[:3, 3] - T_now[:3, 3]) / _STEP
            angles = (turn * Rotation.from_matrix(T_now[:3, :3]).inv()).as_euler("XYZ") / _STEP
            # A step that is too long becomes a shorter one in the same direction, as the controller shortens turns.
            arm = np.concatenate([move / max(1.0, np.abs(move).max()), angles / max(1.0, np.linalg.norm(angles))])
        else:
            arm = np.concatenate([T_target[:3, 3], turn.as_euler("XYZ")])
    if "delta" in mode:
        gripper = np.clip(2 * (gripper - _GRIPPER_LOW) / (_GRIPPER_HIGH - _GRIPPER_LOW) - 1, -1, 1)
    return np.concatenate([arm, gripper, answer]).astype(np.float32)


def to_joint_targets(agent: Any, mode: str, action: np.ndarray) -> np.ndarray:
    """The action (8,) of `pd_joint_pos` that does what ``action`` (8,) of `pd_joint_pos` or `pd_joint_delta_pos` does
    where ``agent`` is now.
    """
    if mode == "pd_joint_pos":
        return np.asarray(action)
    share = (np.clip(action[6:8], -1, 1) + 1) / 2
    gripper = _GRIPPER_LOW + share * (_GRIPPER_HIGH - _GRIPPER_LOW)
    return np.concatenate([_joints(agent) + _STEP * np.clip(action[:6], -1, 1), gripper, action[8:]]).astype(np.float32)


def _joints(agent: Any) -> np.ndarray:
    q: np.ndarray = agent.robot.get_qpos()[0, :6].cpu().numpy()
    return q
