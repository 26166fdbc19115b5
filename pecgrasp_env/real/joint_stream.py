"""Joint targets over time: a motion as it is sent to an arm, target by target."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pecgrasp_env.motion.trajectory import JOINT_SPEED, time_law

PERIOD = 0.008  # s between two targets
_OVERLAP = 1.3  # of a followed target's time: the next one is to come before the arm stands
_SETTLED_RAD = 0.002
_SETTLING_S = 1.0


@dataclass
class JointStream:
    """Targets (T, 6), rad, one every PERIOD. duration: s after which the motion counts as finished; where it settles,
    the arm must have come there, too. Times are those of the controller's clock.
    """

    number: int
    targets: np.ndarray
    duration: float
    settles: bool
    begun: float | None = field(default=None, init=False)

    def target_at(self, time: float) -> np.ndarray:
        """(6,) rad; the first call begins the motion."""
        if self.begun is None:
            self.begun = time - PERIOD
        last = len(self.targets) - 1
        k = float(np.clip((time - self.begun) / PERIOD - 1.0, 0.0, last))
        below = min(int(k), max(last - 1, 0))
        share = k - below
        return np.asarray((1 - share) * self.targets[below] + share * self.targets[min(below + 1, last)])

    def is_over(self, time: float, q: np.ndarray) -> bool:
        """Whether it is finished, the arm measured at q (6,)."""
        if self.begun is None or time - self.begun < self.duration:
            return False
        if not self.settles:
            return True
        off = float(np.abs(q - self.targets[-1]).max())
        return off < _SETTLED_RAD or time - self.begun > self.duration + _SETTLING_S


def along(number: int, waypoints: np.ndarray, speed: float, acceleration: float) -> JointStream:
    """From rest to rest along joint waypoints (K, 6); speed, rad/s, and acceleration, rad/s², of the fastest joint."""
    targets = time_law(waypoints, PERIOD, speed / JOINT_SPEED, acceleration)
    return JointStream(number, targets, len(targets) * PERIOD, settles=True)


def towards(number: int, start: np.ndarray, end: np.ndarray, duration: float, speed: float) -> JointStream:
    """Evenly from one posture (6,) to another, in ``duration`` s or as much later as ``speed``, rad/s, asks for."""
    needed = max(duration, float(np.abs(end - start).max()) / speed)
    shares = np.linspace(0.0, 1.0, max(1, round(_OVERLAP * needed / PERIOD)) + 1)[1:, None]
    return JointStream(number, start + shares * (end - start), needed, settles=False)
