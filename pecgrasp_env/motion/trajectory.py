"""Trajectories: joint paths with a time law within the joints' speeds."""

from __future__ import annotations

import numpy as np

# rad/s and rad/s²: a third of what a UR5 can do, so that neither the arm overshoots nor the load slips.
JOINT_SPEED = 1.0
JOINT_ACCELERATION = 3.0


def time_law(
    waypoints: np.ndarray, dt: float, speed: float = 1.0, acceleration: float = JOINT_ACCELERATION
) -> np.ndarray:
    """Joint targets (T, 6), one every ``dt`` seconds, along a polyline of joint waypoints (K, 6), from rest to rest.

    Trapezoidal: the fastest joint of each segment moves at ``speed`` · JOINT_SPEED at most, and ``acceleration``,
    rad/s². The last target is the last waypoint.
    """
    steps = np.abs(np.diff(waypoints, axis=0)).max(axis=1)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    length = arc[-1]
    if length < 1e-9:
        return waypoints[-1:].copy()
    top = min(speed * JOINT_SPEED, np.sqrt(length * acceleration))
    ramp = top / acceleration
    duration = length / top + ramp
    t = np.arange(1, int(np.ceil(duration / dt)) + 1) * dt
    t = np.minimum(t, duration)
    left = duration - t
    s = np.where(
        t < ramp,
        acceleration * t**2 / 2,
        np.where(left < ramp, length - acceleration * left**2 / 2, top * (t - ramp / 2)),
    )
    return np.stack([np.interp(s, arc, waypoints[:, j]) for j in range(waypoints.shape[1])], axis=1)
