"""How a UR controller moves its joint targets: each motion yields one target (6,) rad a period, until it is at rest."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np


def along(path: np.ndarray, speed: float, acceleration: float, period: float) -> Iterator[np.ndarray]:
    """From rest to rest along joint waypoints (K, 6); the fastest joint of a segment has ``speed``, rad/s, at most."""
    arc = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(path, axis=0)).max(axis=1))])
    length = arc[-1]
    if length > 0:
        top = min(speed, np.sqrt(length * acceleration))
        ramp = top / acceleration
        duration = length / top + ramp
        for k in range(1, int(np.ceil(duration / period))):
            t, left = k * period, duration - k * period
            if t < ramp:
                s = acceleration * t**2 / 2
            elif left < ramp:
                s = length - acceleration * left**2 / 2
            else:
                s = top * (t - ramp / 2)
            yield np.array([np.interp(s, arc, joint) for joint in path.T])
    yield path[-1]


def slow_down(q: np.ndarray, qd: np.ndarray, deceleration: float, period: float) -> Iterator[np.ndarray]:
    """To rest from a posture (6,) rad and rates (6,) rad/s; the fastest joint loses ``deceleration``, rad/s²."""
    top = float(np.abs(qd).max())
    while top > 0:
        slower = max(top - deceleration * period, 0.0)
        q = q + qd / np.abs(qd).max() * (top + slower) / 2 * period
        top = slower
        yield q


def at_rates(
    q: np.ndarray, qd: np.ndarray, wish: np.ndarray, acceleration: float, period: float
) -> Iterator[np.ndarray]:
    """With rates that become ``wish``, (6,) rad/s, and stay; never ends."""
    while True:
        qd = qd + np.clip(wish - qd, -acceleration * period, acceleration * period)
        q = q + qd * period
        yield q


def servo_step(q: np.ndarray, wish: np.ndarray, lookahead: float, period: float) -> np.ndarray:
    """One period of `servoj`: the target smoothed over the look-ahead time, so that it lags by about as much."""
    return np.asarray(q + (wish - q) * -np.expm1(-period / lookahead))
