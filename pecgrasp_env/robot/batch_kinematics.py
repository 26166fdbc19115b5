"""A UR's kinematics for many poses and postures at once: the arithmetic of `kinematics`, on arrays.

A planner of paths asks for the postures of hundreds of poses; one call of NumPy for all of them takes as long as one
call for one. Frames and units as in `kinematics`.
"""

from __future__ import annotations

import numpy as np

from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.measured_arm import frames as measured_frames
from pecgrasp_env.robot.measured_arm import refined

BRANCHES = 8  # shoulder left or right, wrist flipped or not, elbow up or down

_REACH_TOLERANCE = 1e-9  # on a cosine: a pose of a stretched arm may round to just outside


def inverse_kinematics_batch(T_base_tool0: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """Postures (N, 8, 6) in (-π, π] of poses (N, 4, 4), NaN where a branch does not reach the pose.

    Branch b of one pose and branch b of another are of one kind (shoulder, wrist, elbow), so along a path of poses a
    branch is a path of joints. Unlike `inverse_kinematics` it keeps doubles and takes q6 = 0 where the wrist is
    singular.
    """
    T = np.asarray(T_base_tool0, float)
    if arm.measured is not None:
        near = inverse_kinematics_batch(T, arm.with_measured(None)).reshape(-1, 6)
        q = refined(np.repeat(T, BRANCHES, axis=0), near, arm.measured).reshape(-1, BRANCHES, 6)
        return -((-q + np.pi) % (2 * np.pi) - np.pi)
    a2, a3 = arm.dh[1:3, 0]
    d1, d4, d5, d6 = arm.dh[[0, 3, 4, 5], 1]
    R = T[:, :3, :3] * np.array([-1.0, -1.0, 1.0])[:, None]  # base_link against the DH base: half a turn about z
    wrist = T[:, :3, 3] * np.array([-1.0, -1.0, 1.0]) - d6 * R[:, :, 2]
    radius = np.hypot(wrist[:, 0], wrist[:, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        lean = np.arcsin(np.where(radius < d4 * (1 - _REACH_TOLERANCE), np.nan, np.minimum(d4 / radius, 1.0)))
    aim = np.arctan2(wrist[:, 1], wrist[:, 0])
    q1 = np.stack([aim + lean, aim + np.pi - lean], axis=1)[:, :, None]  # (N, shoulder, 1)
    c1, s1 = np.cos(q1), np.sin(q1)
    # The tool's axes along that of joints 2 to 4: (s5 c6, -s5 s6, c5).
    x, y, z = (s1 * R[:, 0, k, None, None] - c1 * R[:, 1, k, None, None] for k in range(3))
    flip = np.array([1.0, -1.0])
    q5 = np.arctan2(flip * np.hypot(x, y), z)  # (N, shoulder, wrist)
    q6 = np.arctan2(-flip * y, flip * x)
    c5, s5, c6, s6 = np.cos(q5), np.sin(q5), np.cos(q6), np.sin(q6)

    def in_base(x: np.ndarray, y: np.ndarray, z: np.ndarray | float) -> list[np.ndarray]:
        """Components of a vector that is given along the tool's axes."""
        return [R[:, k, 0, None, None] * x + R[:, k, 1, None, None] * y + R[:, k, 2, None, None] * z for k in range(3)]

    # The wrist's first body, frame 4, in the arm's plane: where it is, and where its x axis points.
    beside = in_base(d5 * s6, d5 * c6, 0.0)
    ahead = in_base(c5 * c6, -c5 * s6, -s5)
    at = [wrist[:, k, None, None] + beside[k] for k in range(3)]
    px, py = c1 * at[0] + s1 * at[1], at[2] - d1
    heading = np.arctan2(ahead[2], c1 * ahead[0] + s1 * ahead[1])  # q2 + q3 + q4
    cos3 = (px * px + py * py - a2**2 - a3**2) / (2 * a2 * a3)
    cos3 = np.where(np.abs(cos3) > 1 + _REACH_TOLERANCE, np.nan, cos3)[..., None]
    q3 = np.arctan2(flip * np.sqrt(np.maximum(0.0, 1 - cos3 * cos3)), cos3)  # (N, shoulder, wrist, elbow)
    q2 = np.arctan2(py, px)[..., None] - np.arctan2(a3 * np.sin(q3), a2 + a3 * np.cos(q3))
    q4 = heading[..., None] - q2 - q3
    q = np.empty((*q3.shape, 6))
    for joint, value in enumerate((q1[..., None], q2, q3, q4, q5[..., None], q6[..., None])):
        q[..., joint] = value
    q[np.isnan(q).any(axis=-1)] = np.nan
    return -((-q + np.pi) % (2 * np.pi) - np.pi).reshape(-1, BRANCHES, 6)


def nearest_turns(q: np.ndarray, q_ref: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """Joint angles q (…, 6) shifted by whole turns to where they are nearest to `q_ref` (6,) within the limits."""
    turn = 2 * np.pi
    q = q - turn * np.round((q - q_ref) / turn)
    q = np.where(q > arm.limits[:, 1], q - turn, q)
    return np.where(q < arm.limits[:, 0], q + turn, q)


def joint_frames(q: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """T_base_link (…, 6, 4, 4) of the DH frames that follow each joint, of postures q (…, 6); the last is tool0's.

    Those before it are the type's of a measured arm, too.
    """
    q = np.asarray(q, float)
    c, s = np.cos(q), np.sin(q)
    frames = np.zeros((*q.shape, 4, 4))
    a, d, alpha = arm.dh.T
    ca, sa = np.cos(alpha), np.sin(alpha)
    frames[..., 0, 0], frames[..., 0, 1], frames[..., 0, 2], frames[..., 0, 3] = c, -s * ca, s * sa, a * c
    frames[..., 1, 0], frames[..., 1, 1], frames[..., 1, 2], frames[..., 1, 3] = s, c * ca, -c * sa, a * s
    frames[..., 2, 1], frames[..., 2, 2], frames[..., 2, 3] = sa, ca, d
    frames[..., 3, 3] = 1.0
    frames[..., 0, :2, :] *= -1.0  # the half turn between base_link and the DH base
    for joint in range(1, q.shape[-1]):
        frames[..., joint, :, :] = frames[..., joint - 1, :, :] @ frames[..., joint, :, :]
    if arm.measured is not None:
        frames[..., -1, :, :] = measured_frames(q, arm.measured)[..., -1, :, :]
    return frames
