"""Joint paths of an arm: straight lines of the tool, and joint angles up to whole turns and within their limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.batch_kinematics import inverse_kinematics_batch
from pecgrasp_env.robot.kinematics import home, inverse_kinematics

LINE_STEP_M = 0.02  # joints that turn evenly in between leave the line by less than 0.5 mm
_LINE_STEP_RAD = 0.1
# Greatest joint step between two points of a line; more is a jump to another branch of the inverse kinematics.
LARGEST_JOINT_STEP = 0.35


class MotionError(ValueError):
    """No joint path: out of reach, through a singularity, or blocked."""


def straight_line(
    q_start: np.ndarray, T_base_start: np.ndarray, T_base_end: np.ndarray, arm: ArmLengths = UR5
) -> np.ndarray:
    """Joint waypoints (K, 6) that carry the tool in a straight line, turning evenly, from one pose to another.

    Raises:
        MotionError: a point of the line is out of reach, or the joints would have to jump.
    """
    shift = T_base_end[:3, 3] - T_base_start[:3, 3]
    ends = Rotation.from_matrix([T_base_start[:3, :3], T_base_end[:3, :3]])
    angle = (ends[0].inv() * ends[1]).magnitude()
    n_steps = max(1, int(np.ceil(max(np.linalg.norm(shift) / LINE_STEP_M, angle / _LINE_STEP_RAD))))
    fractions = np.linspace(0.0, 1.0, n_steps + 1)[1:]
    poses = np.tile(np.eye(4), (n_steps, 1, 1))
    poses[:, :3, :3] = Slerp([0.0, 1.0], ends)(fractions).as_matrix()
    poses[:, :3, 3] = T_base_start[:3, 3] + fractions[:, None] * shift
    return through_poses(q_start, poses, arm)


def through_poses(q_start: np.ndarray, poses: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """Joint waypoints (K + 1, 6) from a posture through tool poses (K, 4, 4) that follow each other closely.

    Raises:
        MotionError: a pose is out of reach, or the joints would have to jump.
    """
    branches = np.moveaxis(inverse_kinematics_batch(poses, arm), 1, 0)
    fractions = np.linspace(0.0, 1.0, len(poses) + 1)[1:]
    where = f"the line to {np.round(poses[-1, :3, 3], 3)} m"
    q_start = np.asarray(q_start, float)
    first = np.abs(wrapped(branches[:, 0] - q_start)).max(axis=1)
    if np.isnan(first).all():
        raise MotionError(f"out of reach at the start of {where}")
    path = unwound(np.concatenate([q_start[None], branches[int(np.nanargmin(first))]]))
    if np.isnan(path).any():
        reached = fractions[np.isnan(path[1:]).any(axis=1)][0]
        raise MotionError(f"out of reach after {reached:.0%} of {where}")
    steps = np.abs(np.diff(path, axis=0)).max(axis=1)
    if steps.max() > LARGEST_JOINT_STEP:
        raise MotionError(f"the joints jump after {fractions[int(steps.argmax())]:.0%} of {where}")
    if not within_limits(path, arm).all():
        raise MotionError(f"a joint comes to its limit on {where}")
    return path


def unwound(paths: np.ndarray) -> np.ndarray:
    """Joint paths (…, K, 6) whose angles are known up to whole turns, as they go on from their first posture."""
    turn = 2 * np.pi
    turns = np.cumsum(np.round(np.diff(paths, axis=-2) / turn), axis=-2)
    result = paths.copy()
    result[..., 1:, :] -= turn * turns
    return result


def within_limits(q: np.ndarray, arm: ArmLengths = UR5) -> np.ndarray:
    """(…,) bool: whether postures (…, 6) are within the joint limits."""
    return np.asarray(((q >= arm.limits[:, 0]) & (q <= arm.limits[:, 1])).all(axis=-1))


def solutions_near(
    T_base_tool0: np.ndarray, q_now: np.ndarray | None = None, arm: ArmLengths = UR5
) -> Sequence[np.ndarray]:
    """All joint solutions of a tool pose, best first: near home (so the elbow stays up), then a short path from there,
    or from ``q_now`` (6,).
    """
    q_home = home(arm)
    q_now = q_home if q_now is None else q_now
    solutions = inverse_kinematics(T_base_tool0, arm=arm)
    if len(solutions) == 0:
        return []
    cost = np.abs(wrapped(solutions - q_home)).sum(axis=1) + 0.3 * np.abs(solutions - q_now).max(axis=1)
    return list(solutions[np.argsort(cost)])


def wrapped(angles: np.ndarray) -> np.ndarray:
    """Angles, rad, brought to [-π, π)."""
    return (angles + np.pi) % (2 * np.pi) - np.pi
