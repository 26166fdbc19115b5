"""Joint paths for the UR5: straight lines of the tool, time laws within joint speeds, and a check against the table."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.robot.kinematics import COUPLER, DH, forward_kinematics, inverse_kinematics, nearest_solution

# rad/s and rad/s²: a third of what a UR5 can do, so that neither the arm overshoots nor the load slips.
JOINT_SPEED = 1.0
JOINT_ACCELERATION = 3.0
_LINE_STEP_M = 0.01
_LINE_STEP_RAD = 0.1
# Greatest joint step between two points of a line; more is a jump to another branch of the inverse kinematics.
_LARGEST_JOINT_STEP = 0.35


class MotionError(ValueError):
    """No joint path: out of reach, through a singularity, or a link would come below its least height."""


def straight_line(q_start: np.ndarray, T_base_start: np.ndarray, T_base_end: np.ndarray) -> np.ndarray:
    """Joint waypoints (K, 6) that carry the tool in a straight line, turning evenly, from one pose to another.

    Raises:
        MotionError: a point of the line is out of reach, or the joints would have to jump.
    """
    shift = T_base_end[:3, 3] - T_base_start[:3, 3]
    ends = Rotation.from_matrix([T_base_start[:3, :3], T_base_end[:3, :3]])
    angle = (ends[0].inv() * ends[1]).magnitude()
    n_steps = max(1, int(np.ceil(max(np.linalg.norm(shift) / _LINE_STEP_M, angle / _LINE_STEP_RAD))))
    fractions = np.linspace(0.0, 1.0, n_steps + 1)[1:]
    rotations = Slerp([0.0, 1.0], ends)(fractions).as_matrix()
    waypoints = [np.asarray(q_start, float)]
    for fraction, rotation in zip(fractions, rotations, strict=True):
        T = np.eye(4)
        T[:3, :3] = rotation
        T[:3, 3] = T_base_start[:3, 3] + fraction * shift
        q = nearest_solution(T, waypoints[-1])
        if q is None:
            raise MotionError(f"out of reach after {fraction:.0%} of the line to {np.round(T_base_end[:3, 3], 3)} m")
        if np.abs(q - waypoints[-1]).max() > _LARGEST_JOINT_STEP:
            raise MotionError(f"the joints jump after {fraction:.0%} of the line to {np.round(T_base_end[:3, 3], 3)} m")
        waypoints.append(q)
    return np.array(waypoints)


def time_law(waypoints: np.ndarray, dt: float, speed: float = 1.0) -> np.ndarray:
    """Joint targets (T, 6), one every ``dt`` seconds, along a polyline of joint waypoints (K, 6), from rest to rest.

    Trapezoidal: the fastest joint of each segment moves at ``speed`` · JOINT_SPEED at most. The last target is the last
    waypoint.
    """
    steps = np.abs(np.diff(waypoints, axis=0)).max(axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    length = arc[-1]
    if length < 1e-9:
        return waypoints[-1:].copy()
    top = min(speed * JOINT_SPEED, np.sqrt(length * JOINT_ACCELERATION))
    ramp = top / JOINT_ACCELERATION
    duration = length / top + ramp
    t = np.arange(1, int(np.ceil(duration / dt)) + 1) * dt
    t = np.minimum(t, duration)
    left = duration - t
    s = np.where(
        t < ramp,
        JOINT_ACCELERATION * t**2 / 2,
        np.where(left < ramp, length - JOINT_ACCELERATION * left**2 / 2, top * (t - ramp / 2)),
    )
    return np.stack([np.interp(s, arc, waypoints[:, j]) for j in range(waypoints.shape[1])], axis=1)


def joint_origins(q: np.ndarray) -> np.ndarray:
    """Origins (6, 3) of the frames that follow each joint, base frame, metres: from the shoulder to tool0."""
    T = np.diag([-1.0, -1.0, 1.0, 1.0])  # base_link against the base of the DH table
    origins = []
    for angle, (a, d, alpha) in zip(q, DH, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        T = T @ np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])
        origins.append(T[:3, 3])
    return np.array(origins)


def lowest_link(waypoints: np.ndarray) -> float:
    """Height [m, base frame] of the lowest of elbow, wrists and tool0 along a joint path (K, 6)."""
    return min(float(joint_origins(q)[1:, 2].min()) for q in _sampled(waypoints))


def lowest_tip(waypoints: np.ndarray) -> float:
    """Height [m, base frame] of the lowest fingertip along a joint path (K, 6), the gripper open or closed."""
    reach = ROBOTIQ_2F_140.pad_depth(0.0) + ROBOTIQ_2F_140.pad_length / 2 + COUPLER
    return min(float(T[2, 3] + reach * T[2, 2]) for T in map(forward_kinematics, _sampled(waypoints)))


def _sampled(waypoints: np.ndarray, spacing: float = 0.15) -> np.ndarray:
    """The path with a point at least every ``spacing`` rad."""
    dense = [waypoints[:1]]
    for a, b in pairwise(waypoints):
        n = max(1, int(np.ceil(np.abs(b - a).max() / spacing)))
        dense.append(a + (b - a) * np.linspace(0, 1, n + 1)[1:, None])
    return np.concatenate(dense)


def joint_move(q_start: np.ndarray, q_end: np.ndarray) -> np.ndarray:
    """The straight way in joint space, as waypoints (2, 6)."""
    return np.stack([np.asarray(q_start, float), np.asarray(q_end, float)])


def solutions_near(T_base_tool0: np.ndarray, q_home: np.ndarray, q_now: np.ndarray) -> Sequence[np.ndarray]:
    """All joint solutions of a tool pose, best first: near the home posture (so the elbow stays up), then a short way
    to go.
    """
    solutions = inverse_kinematics(T_base_tool0)
    if len(solutions) == 0:
        return []
    cost = np.abs(_wrapped(solutions - q_home)).sum(axis=1) + 0.3 * np.abs(solutions - q_now).max(axis=1)
    return list(solutions[np.argsort(cost)])


def _wrapped(angles: np.ndarray) -> np.ndarray:
    return (angles + np.pi) % (2 * np.pi) - np.pi
