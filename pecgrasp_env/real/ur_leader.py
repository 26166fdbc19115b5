"""The process that leads a Universal Robots arm: `python -m pecgrasp_env.real.ur_leader`, which `URArm` starts.

It has a process of its own for three reasons. Its 125 targets a second do not wait for perception. When the user's
program dies, it stops the arm. And `ur_rtde` reconnects by itself after a lost connection, from a thread that cannot be
stopped: here it ends with the process, so that nothing moves without a word from the user.

It is spoken to in lines of JSON on a socket that it inherits. In: {"path": …} and {"follow": …}, each with a number,
{"stop": number}, {"close": true}. Out: {"time", "q", "qd"} every period, {"done": number}, {"error": [class, text]}.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import sys
import time
from typing import Any

import numpy as np

from pecgrasp_env.real.errors import (
    ConnectionLost,
    EmergencyStop,
    NotInRemoteControl,
    ProtectiveStop,
    RobotError,
    library,
)
from pecgrasp_env.real.joint_stream import PERIOD, JointStream, along, towards

_TOLD = ["timestamp", "actual_q", "actual_qd", "runtime_state", "robot_status_bits", "safety_status_bits"]
_POLL_S = 0.001
_LOOKAHEAD_S, _GAIN = 0.03, 300.0  # of servoj: the least smoothing that it takes
_WATCHDOG_HZ = 4.0  # the arm stands long before: this ends the program, too
_STOP_DECELERATION = 8.0
_ENDING_S = 3  # for the last stop, once nobody is there to lead for
_DASHBOARD_PORT = 29999
_REMOTE_SINCE = (5, 6)  # the PolyScope version from which on there is a local and a remote mode


class Leader:
    """One arm, connected. Raises RobotErrors, as `URArm` says."""

    def __init__(self, where: str, host: str, payload: list[Any] | None, patience: float, unlock: bool) -> None:
        self._where, self._patience = where, patience
        dashboards, receivers, controls = (
            library(name, "ur") for name in ("dashboard_client", "rtde_receive", "rtde_control")
        )
        try:
            self._line = socket.create_connection((host, _DASHBOARD_PORT), timeout=patience)
            self._line.setblocking(False)
            self._dashboard = dashboards.DashboardClient(host)
            self._dashboard.connect()
            self._check_mode(unlock)
            self._receive = receivers.RTDEReceiveInterface(host, -1.0, _TOLD)
            self._control = controls.RTDEControlInterface(host)
            if payload is not None:
                self._control.setPayload(payload[0], payload[1])
            self._control.setWatchdog(_WATCHDOG_HZ)
        except RobotError:
            raise
        except (RuntimeError, ValueError, OSError) as error:
            raise ConnectionLost(f"{where}: {error}; is it on, and is this its address?") from error
        self.time = -1.0
        self.stream: JointStream | None = None
        self._heard = time.monotonic()
        self._target: np.ndarray | None = None  # sent last; None: the arm is not led

    def _check_mode(self, unlock: bool) -> None:
        """Whether the arm is ready to be told what to do."""
        version = tuple(int(part) for part in self._dashboard.polyscopeVersion().split(".")[:2])
        if version >= _REMOTE_SINCE and not self._dashboard.isInRemoteControl():
            raise NotInRemoteControl(f"{self._where} is in local mode: switch to Remote at the pendant's upper right")
        safety = self._dashboard.safetymode()
        if "EMERGENCY" in safety:
            raise EmergencyStop(f"{self._where}: {safety}; release the button, then switch the arm on at the pendant")
        if "PROTECTIVE" in safety:
            if not unlock:
                raise ProtectiveStop(f"{self._where}: {safety}; look what it touches, then recover()")
            self._dashboard.closeSafetyPopup()
            self._dashboard.unlockProtectiveStop()
        if "RUNNING" not in (mode := self._dashboard.robotmode()):
            raise NotInRemoteControl(f"{self._where}: {mode}; switch it on and release the brakes at the pendant")

    @property
    def q(self) -> np.ndarray:
        return np.array(self._receive.getActualQ())

    @property
    def qd(self) -> np.ndarray:
        return np.array(self._receive.getActualQd())

    @property
    def start(self) -> np.ndarray:
        """Where the next motion starts: at the last target, or where the arm is."""
        return self.q if self._target is None else self._target

    def _check_line(self) -> None:
        """The library mends its connections by itself and would go on leading; this one stays closed once it was."""
        try:
            closed = self._line.recv(4096) == b""
        except BlockingIOError:
            return
        except OSError:
            closed = True
        if closed:
            raise ConnectionLost(f"{self._where} closed the connection; check the cable and the controller")

    def new_time(self) -> bool:
        """Whether a period has gone by on the controller's clock. Raises ConnectionLost where it stands still or has
        closed the connection.
        """
        self._check_line()
        now, ours = float(self._receive.getTimestamp()), time.monotonic()
        if now != self.time and now > 0:
            self._heard = ours
        if ours - self._heard > self._patience:
            silent = f"{self._where} has said nothing for {self._patience} s"
            raise ConnectionLost(f"{silent}; check the cable and the controller")
        if now < self.time + PERIOD - 1e-6:
            return False
        self.time = now
        return True

    def send(self) -> int | None:
        """Look how the arm is and send the next target; the number of a motion that has just ended."""
        self.check_safety()
        if self.stream is not None:
            self._target = self.stream.target_at(self.time + PERIOD)  # due once the arm has heard of it
        if self._target is None:
            sent = self._control.kickWatchdog()
        else:
            sent = self._control.servoJ(self._target.tolist(), 0.0, 0.0, PERIOD, _LOOKAHEAD_S, _GAIN)
        if not sent:
            self.check_safety()
            raise NotInRemoteControl(f"{self._where} takes no commands any more; recover()")
        if self.stream is not None and self.stream.is_over(self.time, self.q):
            number, self.stream = self.stream.number, None
            return number
        return None

    def check_safety(self) -> None:
        if self._receive.isEmergencyStopped():
            raise EmergencyStop(f"{self._where}: the emergency stop is pressed; release it, switch on, then recover()")
        if self._receive.isProtectiveStopped():
            raise ProtectiveStop(f"{self._where}: protective stop; look what it touches, then recover()")
        if not self._control.isProgramRunning():
            # A stop for safety ends the program, too, and may be heard of later; the dashboard knows of both.
            self._check_mode(unlock=False)
            raise NotInRemoteControl(f"{self._where}: its program was stopped, at the pendant or for want of words")

    def stop(self) -> None:
        """Slow down; returns at rest."""
        self.stream = None
        if self._target is not None:
            self._target = None
            self._control.servoStop(_STOP_DECELERATION)


class Voice:
    """Lines of JSON on a socket; `hear` returns those that have come, and raises EOFError once nobody is there."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._rest = b""
        connection.setblocking(False)

    def hear(self) -> list[dict[str, Any]]:
        try:
            received = self._socket.recv(1 << 20)
        except BlockingIOError:
            received = None
        except OSError:
            received = b""
        if received == b"":
            raise EOFError
        *lines, self._rest = (self._rest + (received or b"")).split(b"\n")
        return [json.loads(line) for line in lines]

    def say(self, **words: Any) -> None:
        self._socket.setblocking(True)
        try:
            self._socket.sendall((json.dumps(words) + "\n").encode())
        except OSError as error:
            raise EOFError from error
        finally:
            self._socket.setblocking(False)


def lead(leader: Leader, voice: Voice) -> None:
    """Until it is told to close, nobody tells it anything any more, or the connection is lost. After another error it
    only tells how the arm is.
    """
    failed = False
    while True:
        for wish in voice.hear():
            if "close" in wish:
                leader.stop()
                return
            if not failed:
                _wish(leader, voice, wish)
        try:
            if not leader.new_time():
                time.sleep(_POLL_S)
                continue
            ended = None if failed else leader.send()
        except (RobotError, RuntimeError) as error:
            failed = True
            kind = type(error).__name__ if isinstance(error, RobotError) else ConnectionLost.__name__
            voice.say(error=[kind, str(error)])
            if kind == ConnectionLost.__name__:
                return
            continue
        done = {} if ended is None else {"done": ended}
        voice.say(time=leader.time, q=leader.q.tolist(), qd=leader.qd.tolist(), **done)


def _wish(leader: Leader, voice: Voice, wish: dict[str, Any]) -> None:
    replaced = leader.stream
    if "stop" in wish:
        leader.stop()
        voice.say(done=wish["stop"])
    elif "path" in wish:
        waypoints = np.vstack([leader.start, wish["path"]])
        leader.stream = along(wish["number"], waypoints, wish["speed"], wish["acceleration"])
    elif "follow" in wish:
        end = np.array(wish["follow"])
        leader.stream = towards(wish["number"], leader.start, end, wish["duration"], wish["speed"])
    if replaced is not None:
        voice.say(done=replaced.number)


def main(descriptor: int) -> None:
    voice = Voice(socket.socket(fileno=descriptor))
    leader: Leader | None = None
    try:
        while not (first := voice.hear()):
            time.sleep(_POLL_S)
        try:
            leader = Leader(**first[0])
        except RobotError as error:
            voice.say(error=[type(error).__name__, str(error)])
            return
        lead(leader, voice)
    except EOFError:
        if leader is not None:
            # The library waits without an end for a controller that is gone, and holds Python's lock.
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(_ENDING_S)
            leader.stop()


if __name__ == "__main__":
    main(int(sys.argv[1]))
    os._exit(0)  # the library's destructors wait for threads that may be connecting anew without an end
