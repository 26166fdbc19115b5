"""Universal Robots' arms through the library `ur_rtde`: `pip install 'pecgrasp[ur]'`.

The arm is led by joint targets, 125 of them a second, paced by the controller's own clock, from a process of its own
(`ur_leader`). It goes no further than the last target: where that process dies or the cable is pulled, it stops by
itself within a period, and the controller's watchdog then ends the program there. After an error nothing is sent until
`recover` is called.
"""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from importlib.util import find_spec
from typing import Any

import numpy as np

from pecgrasp_env.motion.joint_path import straight_line
from pecgrasp_env.motion.trajectory import JOINT_ACCELERATION, JOINT_SPEED
from pecgrasp_env.real import errors
from pecgrasp_env.real.errors import ConnectionLost, JointLimit, MissingExtra, MotionTimeout, RobotError, SpeedLimit
from pecgrasp_env.real.interfaces import ArmState
from pecgrasp_env.real.ur_measured import lengths_of
from pecgrasp_env.real.ur_models import UR5, URModel
from pecgrasp_env.robot.kinematics import forward_kinematics

_AT_REST_RAD_S = 0.02
_CONNECTING_S = 30.0  # besides the patience with the controller
_ENDING_S = 5.0
_MORE_PATIENCE_S = 2.0  # with the leading process than with the controller


class URMotion:
    """An arm on its way."""

    def __init__(self, arm: URArm, number: int) -> None:
        self._arm, self.number = arm, number
        self._ended = threading.Event()
        self._error: RobotError | None = None

    def end(self, error: RobotError | None = None) -> None:
        self._error = error
        self._ended.set()

    @property
    def done(self) -> bool:
        """Whether it has ended, for whatever reason."""
        return self._ended.is_set()

    def wait(self, timeout: float) -> None:
        """As `interfaces.Motion.wait`."""
        if not self._ended.wait(timeout):
            raise MotionTimeout(f"the arm is still on its way after {timeout} s; wait again or cancel")
        if self._error is not None:
            raise self._error

    def cancel(self) -> None:
        """Slow down and stop; returns at rest. What has ended already is left alone."""
        if not self.done:
            self._arm.stop()


class URArm:
    """An arm at a network address, switched on, its brakes released, in remote mode where it has one.

    Args:
        host: the controller's address.
        model: which arm it is.
        speed, acceleration: the most that a motion uses of a joint, rad/s and rad/s².
        payload: mass of gripper and what it may hold, kg, and (3,) its centre in tool0, m.
        patience: s of our clock that the controller's may stand still before the connection counts as lost.

    `lengths` are those that the controller tells of its own arm. Raises ConnectionLost, WrongArm, NotInRemoteControl,
    ProtectiveStop, EmergencyStop, SpeedLimit, MissingExtra.
    """

    def __init__(
        self,
        host: str,
        model: URModel = UR5,
        *,
        speed: float = JOINT_SPEED,
        acceleration: float = JOINT_ACCELERATION,
        payload: tuple[float, tuple[float, float, float]] | None = None,
        patience: float = 1.0,
    ) -> None:
        if not 0 < speed <= float(model.max_speed.min()):
            raise SpeedLimit(f"speed={speed} rad/s: {model.name}'s slowest joint does {model.max_speed.min():.3g}")
        if not 0 < acceleration <= 40:
            raise SpeedLimit(f"acceleration={acceleration} rad/s²: must be positive and at most 40")
        if payload is not None and not 0 <= payload[0] <= model.max_payload:
            raise SpeedLimit(f"payload={payload[0]} kg: {model.name} carries {model.max_payload} kg")
        if find_spec("rtde_control") is None:
            raise MissingExtra("ur_rtde is not installed: pip install 'pecgrasp[ur]'")
        self.host, self.model, self.speed, self.acceleration = host, model, speed, acceleration
        self._payload, self._patience = payload, patience
        self.lengths = lengths_of(host, model, patience)
        self._start(unlock=False)

    # ------------------------------------------------------------ for users

    @property
    def state(self) -> ArmState:
        """Measured. Raises ConnectionLost where that is old."""
        if isinstance(self._error, ConnectionLost):
            raise self._error
        if time.monotonic() - self._heard > self._patience + _MORE_PATIENCE_S:
            raise ConnectionLost(f"{self._where}: the process that leads it has become silent")
        return self._state

    @property
    def error(self) -> RobotError | None:
        """What stopped the arm, until `recover`."""
        return self._error

    def move_joints(self, path: np.ndarray) -> URMotion:
        """Along joint waypoints (K, 6), rad, from where the arm is, from rest to rest."""
        path = np.atleast_2d(np.asarray(path, float))
        self._check_path(path)
        return self._begin(path=path.tolist(), acceleration=self.acceleration)

    def move_linear(self, T_base_tool0: np.ndarray) -> URMotion:
        """The flange in a straight line, turning evenly. Raises MotionError where the arm cannot."""
        q, arm = self.state.q, self.lengths
        return self.move_joints(straight_line(q, forward_kinematics(q, arm), np.asarray(T_base_tool0, float), arm)[1:])

    def follow(self, q: np.ndarray, duration: float) -> URMotion:
        """Evenly to joint angles (6,) within ``duration`` s, or as much later as `speed` makes necessary."""
        q = np.asarray(q, float)
        self._check_path(q[None])
        return self._begin(follow=q.tolist(), duration=duration)

    def stop(self) -> None:
        """Slow down and stop; returns at rest. Raises what stopped the arm already."""
        self._send(stop=(motion := self._new()).number)
        motion.wait(_ENDING_S)
        deadline = time.monotonic() + _ENDING_S
        while np.abs(self.state.qd).max() > _AT_REST_RAD_S:
            if time.monotonic() > deadline:
                raise MotionTimeout(f"{self._where} still moves {_ENDING_S} s after it was told to stop")
            time.sleep(0.001)

    def recover(self) -> None:
        """Make the arm ready again after an error: release a protective stop, connect and start the program anew.

        Says nothing about whether that is safe: ask the user first. Raises the error that is still there.
        """
        self._end()
        self._start(unlock=True)

    def close(self) -> None:
        """Stop and disconnect."""
        self._end()

    # ------------------------------------------------------------ the process that leads it

    @property
    def _where(self) -> str:
        return f"{self.model.name} at {self.host}"

    def _start(self, unlock: bool) -> None:
        self._error: RobotError | None = None
        self._motions: dict[int, URMotion] = {}
        self._number = 0
        self._lock = threading.Lock()
        self._socket, theirs = socket.socketpair()
        self._closing = False
        with theirs:
            command = [sys.executable, "-m", "pecgrasp_env.real.ur_leader", str(theirs.fileno())]
            self._process = subprocess.Popen(
                command, pass_fds=[theirs.fileno()], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
        self._first = threading.Event()
        self._heard = time.monotonic()
        self._thread = threading.Thread(target=self._listen, args=(self._socket,), daemon=True)
        self._thread.start()
        first = {"where": self._where, "host": self.host, "payload": self._payload, "patience": self._patience}
        self._send(**first, unlock=unlock)
        if not self._first.wait(_CONNECTING_S + self._patience):
            self._fail(ConnectionLost(f"{self._where} did not answer in time"))
        if self._error is not None:
            error = self._error
            self._end()
            raise error

    def _end(self) -> None:
        """End the process, by force where it does not want to."""
        self._closing = True
        with suppress(OSError):
            self._socket.sendall(b'{"close": true}\n')
        try:
            self._process.wait(_ENDING_S if self._error is None else 0.2)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join()
        self._socket.close()

    def _new(self) -> URMotion:
        if self._error is not None:
            raise self._error
        with self._lock:
            self._number += 1
            motion = URMotion(self, self._number)
            self._motions[motion.number] = motion
        return motion

    def _begin(self, **wish: Any) -> URMotion:
        motion = self._new()
        self._send(number=motion.number, speed=self.speed, **wish)
        return motion

    def _send(self, **wish: Any) -> None:
        try:
            self._socket.sendall((json.dumps(wish) + "\n").encode())
        except OSError as error:
            self._thread.join(_ENDING_S)  # what it said last may not be read yet
            ended = ConnectionLost(f"{self._where}: the process that leads it has ended; recover()")
            raise self._error or ended from error

    def _check_path(self, path: np.ndarray) -> None:
        if path.ndim != 2 or path.shape[1] != 6 or not len(path) or not np.isfinite(path).all():
            raise JointLimit(f"a path is (K, 6) finite joint angles, rad, got shape {path.shape}")
        low, high = self.model.limits.T
        outside = (path < low) | (path > high)
        if outside.any():
            k, joint = np.argwhere(outside)[0]
            limits = f"{low[joint]:.3f} … {high[joint]:.3f}"
            raise JointLimit(f"joint {joint + 1} to {path[k, joint]:.3f} rad: {self.model.name} goes {limits} rad")

    def _listen(self, connection: socket.socket) -> None:
        """What the leading process says, line by line."""
        with connection.makefile("r") as lines:
            try:
                for line in lines:
                    self._told(json.loads(line))
            except (OSError, ValueError):
                pass
        if not self._closing and self._error is None:
            self._fail(ConnectionLost(f"{self._where}: the process that leads it has died; recover()"))

    def _told(self, words: dict[str, Any]) -> None:
        if "error" in words:
            kind, text = words["error"]
            self._fail(getattr(errors, kind)(text))
        if "q" in words:
            self._state = ArmState(np.array(words["q"]), np.array(words["qd"]), words["time"])
            self._heard = time.monotonic()
            self._first.set()
        if "done" in words:
            with self._lock:
                motion = self._motions.pop(words["done"], None)
            if motion is not None:
                motion.end()

    def _fail(self, error: RobotError) -> None:
        with self._lock:
            self._error = error
            motions, self._motions = self._motions, {}
        self._first.set()
        for motion in motions.values():
            motion.end(error)
