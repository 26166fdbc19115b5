"""Kinematics of one arm as its maker measured it: near to those of its type, and without a closed form.

A measured table may have offsets of many metres along the parallel axes of joints 2 to 4, which cancel each other, so
only its last frame is where a part of the arm is.
"""

from __future__ import annotations

import numpy as np

_T_BASE_DH = np.diag([-1.0, -1.0, 1.0, 1.0])
_ROUNDS = 12
_DAMPING = 1e-9  # of a singular posture: far below what a step needs elsewhere
_LONGEST_STEP_RAD = 0.3
_REACHED = 1e-8  # m and rad


def frames(q: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """T_base_frame (…, 7, 4, 4): the base of the table and what follows each joint, at joint angles q (…, 6), rad.

    measured: (6, 4) theta, a, d, alpha, as `ArmLengths` has them. The last is T_base_tool0.
    """
    theta, a, d, alpha = measured.T
    angle = np.asarray(q, float) + theta
    c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
    steps = np.zeros((*angle.shape, 4, 4))
    steps[..., 0, 0], steps[..., 0, 1], steps[..., 0, 2], steps[..., 0, 3] = c, -s * ca, s * sa, a * c
    steps[..., 1, 0], steps[..., 1, 1], steps[..., 1, 2], steps[..., 1, 3] = s, c * ca, -c * sa, a * s
    steps[..., 2, 1], steps[..., 2, 2], steps[..., 2, 3] = sa, ca, d
    steps[..., 3, 3] = 1.0
    found = np.empty((*angle.shape[:-1], 7, 4, 4))
    found[..., 0, :, :] = _T_BASE_DH
    for joint in range(6):
        found[..., joint + 1, :, :] = found[..., joint, :, :] @ steps[..., joint, :, :]
    return found


def refined(T_base_tool0: np.ndarray, q: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Postures (N, 6) of the measured arm at poses (N, 4, 4), from those q (N, 6) of its type; NaN where q is, and
    where none is near: at the edge of its reach, or where the wrist is singular.

    Newton's method on the twist from pose to pose.
    """
    q, found = np.array(q, float), np.full(np.shape(q), np.nan)
    rows = np.flatnonzero(np.isfinite(q).all(axis=1))
    for _ in range(_ROUNDS):
        now = frames(q[rows], measured)
        error = _twist(now[:, -1], T_base_tool0[rows])
        there = np.abs(error).max(axis=1) < _REACHED
        found[rows[there]] = q[rows[there]]
        rows, now, error = rows[~there], now[~there], error[~there]
        if not len(rows):
            break
        axis = now[:, :6, :3, 2]
        arm = now[:, -1:, :3, 3] - now[:, :6, :3, 3]
        J = np.concatenate([np.cross(axis, arm), axis], axis=2).swapaxes(1, 2)
        square = J.swapaxes(1, 2) @ J + _DAMPING * np.eye(6)
        step = np.linalg.solve(square, J.swapaxes(1, 2) @ error[..., None])[..., 0]
        q[rows] += step * np.minimum(1.0, _LONGEST_STEP_RAD / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
    return found


def _twist(T: np.ndarray, towards: np.ndarray) -> np.ndarray:
    """(N, 6) m and rad, base frame, that carries poses T (N, 4, 4) nearly to others."""
    R = towards[:, :3, :3] @ T[:, :3, :3].swapaxes(1, 2)
    skew = R - R.swapaxes(1, 2)
    sine = 0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
    return np.concatenate([towards[:, :3, 3] - T[:, :3, 3], sine], axis=1)
