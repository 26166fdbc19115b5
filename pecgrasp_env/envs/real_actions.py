"""Actions of SelectiveGrasp-v1's control modes as joint targets of a real arm, without a simulator's controllers."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot import gripper_linkage as linkage
from pecgrasp_env.robot.arm_lengths import JOINT_LIMITS, UR5, ArmLengths
from pecgrasp_env.robot.kinematics import T_TOOL0_TCP, forward_kinematics, nearest_solution

CONTROL_MODES = ("pd_joint_pos", "pd_joint_delta_pos", "pd_ee_pose", "pd_ee_delta_pose")
_STEP = 0.1  # of ±1 in the modes with delta: rad of a joint or of the tool, m of the tool
_LOW, _HIGH = np.array([0.0, linkage.MIN_FORCE]), np.array([linkage.STROKE, linkage.MAX_FORCE])
_JUMP_RAD = 0.7  # of a joint in one step of the tool: more is another branch of the inverse kinematics


class OutOfReach(ValueError):
    """An action leads where the arm cannot go; the message says where."""


def joint_targets(control_mode: str, action: np.ndarray, q_now: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """Joint angles (6,), rad, to which the part (6,) of an action of a mode that is the arm's leads from q_now (6,).

    Raises OutOfReach where they are outside of the joints' limits, or no posture has the tool there.
    """
    if control_mode == "pd_joint_pos":
        q = np.asarray(action, float)
    elif control_mode == "pd_joint_delta_pos":
        q = q_now + _STEP * action
    else:
        T = forward_kinematics(q_now, arm) @ T_TOOL0_TCP
        if control_mode == "pd_ee_delta_pose":
            turn = (
                _STEP * action[3:] / max(1.0, float(np.linalg.norm(action[3:])))
            )  # as the simulation's controller does
            T[:3, 3] += _STEP * action[:3]
            T[:3, :3] = Rotation.from_euler("XYZ", turn).as_matrix() @ T[:3, :3]
        else:
            T[:3, 3], T[:3, :3] = action[:3], Rotation.from_euler("XYZ", action[3:]).as_matrix()
        found = nearest_solution(T @ np.linalg.inv(T_TOOL0_TCP), q_now, arm)
        if found is None:
            raise OutOfReach(f"no posture of the arm has the tool at {np.round(T[:3, 3], 3).tolist()} m, turned so")
        if "delta" in control_mode and np.abs(found - q_now).max() > _JUMP_RAD:
            raise OutOfReach("the arm would have to swing round: it is near a singularity")
        q = found
    low, high = arm.limits.T
    outside = (q < low) | (q > high)
    if outside.any():
        joint = int(np.argmax(outside))
        raise OutOfReach(f"joint {joint + 1} to {q[joint]:.3f} rad: {low[joint]:.3f} … {high[joint]:.3f}")
    return q


def gripper_target(control_mode: str, values: np.ndarray) -> tuple[float, float]:
    """Opening, m, and force, N, of the gripper's part (2,) of an action of a mode."""
    if "delta" in control_mode:
        values = _LOW + (np.clip(values, -1, 1) + 1) / 2 * (_HIGH - _LOW)
    opening, force = np.clip(values, _LOW, _HIGH)
    return float(opening), float(force)


def action_space(control_mode: str) -> spaces.Box:
    """Of SelectiveGraspSingle-v1 in a control mode."""
    if "delta" in control_mode:
        return spaces.Box(-1.0, 1.0, (8,), np.float32)
    if control_mode == "pd_joint_pos":
        low, high = JOINT_LIMITS.T
    else:
        high = np.array([2.0] * 3 + [2 * np.pi] * 3)
        low = -high
    return spaces.Box(
        np.concatenate([low, _LOW]).astype(np.float32),
        np.concatenate([high, _HIGH]).astype(np.float32),
        dtype=np.float32,
    )
