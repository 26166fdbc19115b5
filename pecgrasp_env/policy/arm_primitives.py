"""The small movements of which a pick consists, as generators: each ``yield`` is one control step.

A generator yields actions (8,) of the control mode `pd_joint_pos` and is sent the observation that follows; it returns
the last one.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import Any

import numpy as np

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.motion.joint_path import MotionError, straight_line
from pecgrasp_env.motion.trajectory import time_law
from pecgrasp_env.policy.observation import RobotObservation
from pecgrasp_env.robot.kinematics import forward_kinematics

Steps = Generator[np.ndarray, RobotObservation, Any]

_CLOSING_SPEED = 0.15  # m/s of opening: the arm, drawn back meanwhile, keeps up
_STILL_OPENING_M = 0.0003  # a gripper whose opening changes by less within a step has stopped
_MORE_CLOSING_STEPS = 11  # than the whole stroke takes
_OPENING_S = 0.5
_SAFE_TOOL_M = 0.45  # height of tool0 at which the fingertips pass over everything on the table
_SETTLED_RAD = 0.003  # 1.5 mm at the tips at most
# Following a path of half speed the arm lags by 0.015 rad and the opening by less than 0.1 mm.
_LED_STEPS = 1.5  # the arm lags by about half a step behind what it is sent
_BLOCKED_RAD = 0.03
_LOWERING_SPEED = 0.3  # at which the arm lags by 0.01 rad by itself
_RESISTED_RAD = 0.02
_BLOCKED_OPENING_M = 0.0015
_LONGEST_SETTLING_STEPS = 15


class ArmSteps:
    """Moves the arm and the gripper. control_dt: seconds between two steps; force: limit of the grip, N."""

    def __init__(self, observation: RobotObservation, control_dt: float, force: float) -> None:
        self.force = force
        self._control_dt = control_dt
        self.command = np.array([*observation.q, ROBOTIQ_2F_140.stroke, force], np.float32)
        self.way: np.ndarray | None = None  # waypoints (K, 6) that it follows, or followed last

    def _action(self, q: np.ndarray, opening: float) -> np.ndarray:
        self.command = np.array([*q, opening, self.force], np.float32)
        return self.command

    def go(
        self,
        waypoints: np.ndarray,
        observation: RobotObservation,
        *,
        opening: float,
        speed: float = 1.0,
        careful: bool = False,
    ) -> Steps:
        """Follow joint waypoints (K, 6) and wait until the arm is there; ``careful`` stops where something resists."""
        self.way = waypoints
        for q in time_law(waypoints, self._control_dt, speed):
            observation = yield self._action(q, opening)
            if careful and self.blocked(observation, opening):
                return (yield self._action(observation.q, opening))
        for _ in range(_LONGEST_SETTLING_STEPS):
            if np.abs(observation.q - waypoints[-1]).max() < _SETTLED_RAD:
                break
            observation = yield self._action(waypoints[-1], opening)
        return observation

    def blocked(self, observation: RobotObservation, opening: float) -> bool:
        """Whether the arm or the fingers are kept from where they were sent, further than they lag by themselves."""
        lag = float(np.abs(observation.q - self.command[:6]).max())
        return lag > _BLOCKED_RAD or abs(observation.opening - opening) > _BLOCKED_OPENING_M

    def close(self, observation: RobotObservation, posture_at: Callable[[float], np.ndarray]) -> Steps:
        """Close and wait until the fingers stand still, on something or on each other.

        posture_at: opening, m → joint angles (6,) that keep the fingertips where they are to hold. The arm follows the
        opening that was commanded while the fingers do, and the one that is measured where something stops them.
        """
        return (yield from self._shut(observation, posture_at, observation.opening))

    def squeeze(self, observation: RobotObservation) -> Steps:
        """Hold on, the arm where it is, until the fingers stand still."""
        q = self.command[:6]
        return (yield from self._shut(observation, lambda _: q, 0.0))

    def wait(self, observation: RobotObservation, seconds: float) -> Steps:
        """Hold on, the arm where it is, for so long."""
        for _ in range(round(seconds / self._control_dt)):
            observation = yield self._action(self.command[:6], 0.0)
        return observation

    def _shut(self, observation: RobotObservation, posture_at: Callable[[float], np.ndarray], wish: float) -> Steps:
        """As `close`, the opening that is commanded falling evenly from ``wish``, m."""
        stride = _CLOSING_SPEED * self._control_dt
        moved, still = stride, 0
        for _ in range(int(np.ceil(ROBOTIQ_2F_140.stroke / stride)) + _MORE_CLOSING_STEPS):
            before = observation.opening
            wish = max(wish - stride, 0.0)
            observation = yield self._action(posture_at(max(wish, before - _LED_STEPS * moved)), wish)
            moved = before - observation.opening
            still = still + 1 if abs(moved) < _STILL_OPENING_M else 0
            if still == 3:
                break
        return observation

    def lower(self, waypoints: np.ndarray, observation: RobotObservation) -> Steps:
        """Follow joint waypoints (K, 6) down with what is held, until it touches something or the arm is there."""
        for q in time_law(waypoints, self._control_dt, _LOWERING_SPEED):
            observation = yield self._action(q, 0.0)
            if np.abs(observation.q - self.command[:6]).max() > _RESISTED_RAD:
                return (yield self._action(observation.q, 0.0))
        return observation

    def let_go(self, observation: RobotObservation, opening: float = ROBOTIQ_2F_140.stroke) -> Steps:
        """Open where the hand is, up to an opening (m)."""
        for _ in range(round(_OPENING_S / self._control_dt)):
            observation = yield self._action(self.command[:6], opening)
        return observation

    def rise(self, observation: RobotObservation) -> Steps:
        """Straight up with an open hand, as far as the arm reaches, out of what stands around."""
        T = forward_kinematics(observation.q, observation.arm)
        for height in np.arange(_SAFE_TOOL_M - T[2, 3], 0.0, -0.05):
            T_up = T.copy()
            T_up[2, 3] += height
            try:
                line = straight_line(observation.q, T, T_up, observation.arm)
            except MotionError:
                continue
            return (yield from self.go(line, observation, opening=ROBOTIQ_2F_140.stroke))
        return observation
