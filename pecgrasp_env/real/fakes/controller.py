"""A Universal Robots controller without its sockets: registers, states, stops, and the joint targets of each period."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.real.fakes.motions import along, servo_step, slow_down
from pecgrasp_env.real.fakes.plant import Plant
from pecgrasp_env.real.fakes.robotiq_server import FakeRobotiq
from pecgrasp_env.robot.kinematics import forward_kinematics

STOPPED, PLAYING = 1, 2  # runtime states
_RUNNING_MODE = 7
_STOP_DECELERATION = 40.0  # rad/s², the most that a UR does: of a stop for safety's sake and of a program that ends
T_CONTROLLER_BASE = np.diag([-1.0, -1.0, 1.0, 1.0])  # the controller's base frame is turned by half a turn
_DOUBLES, _INTEGERS = 48, 48


@dataclass(frozen=True)
class Version:
    """What the controller says that it is: CB3 has major version 3, e-Series 5."""

    major: int
    minor: int

    @property
    def polyscope(self) -> str:
        return f"URSoftware {self.major}.{self.minor}.0.0 (Jan 01 2020)"


CB3, E_SERIES = Version(3, 15), Version(5, 12)


class Controller:
    """``program``: what runs, with `step()` and `stop()`; None when nothing does. ``time``: s since it was switched on.

    ``remote``: an e-Series takes programs from outside in remote mode only. ``tells_lengths``: those of the plant's
    arm, to who connects, as since PolyScope 3.6. ``pace``: simulated seconds a second; the client's processor is no
    faster than the clock on the wall, so its watchdog waits that many times longer where the pace is above 1.
    """

    def __init__(self, plant: Plant, gripper: FakeRobotiq, version: Version = CB3, pace: float = 1.0) -> None:
        self.plant, self.gripper, self.version = plant, gripper, version
        self.period = plant.period
        self._patience = max(pace, 1.0)
        self.integers_in, self.doubles_in = [0] * _INTEGERS, [0.0] * _DOUBLES
        self.integers_out, self.doubles_out = [0] * _INTEGERS, [0.0] * _DOUBLES
        self.time = 0.0
        self.remote = True
        self.tells_lengths = True
        self.tcp = np.zeros(6)
        self.payload = (0.0, np.zeros(3))
        self.speed_fraction = 1.0
        self.protective, self.emergency = False, False
        self.program: Program | None = None
        self.watchdog: tuple[float, float] | None = None  # longest silence, s, and the time of the last word
        self._left = 0.0  # of a period, that a slowed down motion still has to its next target
        self.reset()

    def reset(self) -> None:
        """No program and no motion, the target where the arm is."""
        self.program, self.watchdog = None, None
        self.target = np.array(self.plant.q, float)
        self.rates = np.zeros(6)
        self._motion: Iterator[np.ndarray] | None = None
        self._servo: tuple[np.ndarray, float] | None = None  # target and look-ahead time, s
        self._measured = self.target.copy()
        self.measured_rates = np.zeros(6)

    # ------------------------------------------------------------ what a program does

    def move(self, path: np.ndarray, speed: float, acceleration: float) -> None:
        """Along joint waypoints (K, 6), from where the target is now."""
        self._servo = None
        whole = np.vstack([self.target, path])
        self._motion = along(whole, speed, acceleration, self.period)

    def run(self, motion: Iterator[np.ndarray]) -> None:
        """Any motion of `motions`."""
        self._servo = None
        self._motion = motion

    def servo(self, q: np.ndarray, lookahead: float) -> None:
        self._motion = None
        self._servo = (q, max(lookahead, self.period))

    def slow_down(self, deceleration: float = _STOP_DECELERATION) -> None:
        self.run(slow_down(self.target, self.rates, deceleration, self.period))

    @property
    def moving(self) -> bool:
        return self._motion is not None

    # ------------------------------------------------------------ stops

    def protective_stop(self) -> None:
        self.protective = True
        self.stop_program()

    def emergency_stop(self) -> None:
        self.emergency = True
        self.stop_program()

    def unlock(self) -> bool:
        """Release a protective stop; whether there was nothing against it."""
        self.protective = False
        return not self.emergency

    def stop_program(self) -> None:
        """End whatever runs and stop the arm; watchdogs end with it."""
        self.program, self.watchdog = None, None
        self.slow_down()

    def start(self, program: Program) -> None:
        """Instead of the one that runs. In local mode and after stops nothing starts."""
        if self.protective or self.emergency or not self.remote:
            return
        if self.program is not None:
            self.stop_program()
        self.program = program

    # ------------------------------------------------------------ a period

    def set_watchdog(self, least_hz: float) -> None:
        """End the program when the client is silent for longer than a period of this rate."""
        self.watchdog = (self._patience / max(least_hz, 1e-3), self.time)

    def word_from_client(self, register: int) -> None:
        """A client has written an integer register: that is what watchdogs wait for."""
        if self.watchdog is not None and register in (0, 24):
            self.watchdog = (self.watchdog[0], self.time)

    def tick(self) -> None:
        """One period of controller, arm and gripper."""
        self.time += self.period
        if self.watchdog is not None and self.time - self.watchdog[1] > self.watchdog[0]:
            self.stop_program()
        if self.program is not None and not self.program.step():
            self.stop_program()
        before = self.target
        if self._servo is not None:
            wish, lookahead = self._servo
            self.target = servo_step(self.target, wish, lookahead, self.period)
        elif self._motion is not None:
            self._left += self.speed_fraction
            while self._left >= 1.0 and self._motion is not None:
                self._left -= 1.0
                reached = next(self._motion, None)
                if reached is None:
                    self._motion = None
                else:
                    self.target = reached
        self.rates = (self.target - before) / self.period
        low, high = self.plant.arm.limits.T
        if ((self.target < low) | (self.target > high)).any():
            self.target, self.rates = before, np.zeros(6)
            self.protective_stop()
        self.plant.step(self.target, self.gripper.opening, self.gripper.force)
        self.gripper.step(self.plant.opening, self.period)
        measured = np.array(self.plant.q, float)
        self.measured_rates = (measured - self._measured) / self.period
        self._measured = measured

    # ------------------------------------------------------------ what it tells

    @property
    def measured(self) -> np.ndarray:
        """(6,) rad."""
        return self._measured

    @property
    def robot_status(self) -> int:
        """Bit 0: power; 1: a program runs; 3: the power button is pressed."""
        return (0 if self.emergency else 1) | (2 if self.program is not None else 0)

    @property
    def safety_status(self) -> int:
        """Bit 0: normal; 2: protective stop; 6, 7: emergency stop; 10: stopped for safety's sake."""
        stopped = self.protective or self.emergency
        bits = (1 << 2) * self.protective | ((1 << 6) | (1 << 7)) * self.emergency
        return bits | (1 << 10) * stopped | (not stopped)

    @property
    def safety_mode(self) -> int:
        return 7 if self.emergency else 3 if self.protective else 1

    @property
    def robot_mode(self) -> int:
        return 3 if self.emergency else _RUNNING_MODE  # 3: power off

    @property
    def runtime_state(self) -> int:
        return PLAYING if self.program is not None else STOPPED

    def tool_pose(self, q: np.ndarray) -> np.ndarray:
        """(6,) place, m, and rotation vector, rad, of the tool centre point in the controller's base frame."""
        T = T_CONTROLLER_BASE @ forward_kinematics(q, self.plant.arm) @ matrix_of(self.tcp)
        return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec()])


def matrix_of(pose: np.ndarray) -> np.ndarray:
    """(4, 4) of a place, m, and a rotation vector, rad, (6,)."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(pose[3:]).as_matrix()
    T[:3, 3] = pose[:3]
    return T


class Program:
    """What the controller runs."""

    def step(self) -> bool:
        """One period; whether it goes on."""
        raise NotImplementedError
