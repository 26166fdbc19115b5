"""Robotiq's 2F grippers through the socket of their URCap: lines of text on port 63352 of the arm's controller.

`GET POS` is answered `POS 12`, `SET POS 255 GTO 1` is answered `ack`. All values are 0 … 255; the names are those of
Robotiq's instruction manual (registers of the gripper): ACT activate, GTO go to, POS position, SPE speed, FOR force,
PRE the position that was asked for; STA 0 reset, 1 activating, 3 active; OBJ 0 on its way, 1 and 2 stopped by
something while it opened and closed, 3 arrived; FLT see `FAULTS`. The URCap speaks this, too, where the gripper hangs
on the arm's tool connector instead of a controller's USB port.
"""

from __future__ import annotations

import socket
import threading
import time

import numpy as np

from pecgrasp_env.real.errors import ConnectionLost, GripperFault, MotionTimeout, SpeedLimit
from pecgrasp_env.robot import gripper_linkage as linkage

PORT = 63352
SPEEDS = (0.030, 0.250)  # m/s at SPE 0 and 255, of a 2F-140
FORCES = (10.0, 125.0)  # N at FOR 0 and 255
ACTIVE = 3
FAULTS = {
    0: "none",
    5: "a motion was asked for while it activates",
    7: "it is not activated",
    8: "it is too hot",
    9: "it was not spoken to for a second",
    10: "its supply voltage is too low",
    11: "an emergency release is going on",
    12: "internal fault",
    13: "it could not be activated",
    14: "too much current: a finger is stuck",
    15: "an emergency release has ended",
}
_HARMLESS = (0, 9)
_ANSWER_S = 2.0
_POLL_S = 0.02
_ACTIVATION_S = 10.0


def opening_of(position: float, open_position: int, closed_position: int) -> float:
    """Opening, m, of a 2F-140 at a position register: the cranks turn evenly with it, so the pads nearly do."""
    ends = linkage.crank_joint([linkage.STROKE, 0.0])
    share = (position - open_position) / (closed_position - open_position)
    return float(linkage.opening(ends[0] + share * (ends[1] - ends[0])))


def position_of(opening: float, open_position: int, closed_position: int) -> int:
    """The position register, 0 … 255, at which a 2F-140 has an opening, m."""
    ends = linkage.crank_joint([linkage.STROKE, 0.0])
    share = (linkage.crank_joint(opening) - ends[0]) / (ends[1] - ends[0])
    return int(np.clip(np.round(open_position + share * (closed_position - open_position)), 0, 255))


class RobotiqGripper:
    """A 2F-140 behind a URCap.

    Args:
        host: of the arm's controller. port: of the URCap.
        open_position, closed_position: what POS reads with the fingers fully open and fully closed; each gripper has
            its own, `calibrate` finds them.

    Raises ConnectionLost where nobody answers.
    """

    def __init__(self, host: str, port: int = PORT, *, open_position: int = 3, closed_position: int = 230) -> None:
        self._where = f"the gripper at {host}:{port}"
        self.open_position, self.closed_position = open_position, closed_position
        self._lock = threading.Lock()
        self._rest = b""
        try:
            self._socket = socket.create_connection((host, port), timeout=_ANSWER_S)
        except OSError as error:
            raise ConnectionLost(
                f"{self._where}: {error}; is the Robotiq URCap installed and the gripper on?"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def get(self, name: str) -> int:
        """A register, 0 … 255."""
        answer = self._ask(f"GET {name}\n").split()
        if len(answer) != 2 or answer[0] != name or not answer[1].isdigit():
            raise ConnectionLost(f"{self._where} answers {' '.join(answer)!r} to GET {name}: another program's port?")
        return int(answer[1])

    def set(self, **registers: int) -> None:
        """Write registers, by their names."""
        answer = self._ask("SET " + " ".join(f"{name} {value}" for name, value in registers.items()) + "\n")
        if answer != "ack":
            raise GripperFault(f"{self._where} answers {answer!r} to SET {registers}")

    def activate(self, timeout: float = _ACTIVATION_S) -> None:
        """Make it ready; where it is not yet, the fingers open and close fully: keep clear. Raises GripperFault."""
        if self.get("STA") == ACTIVE and self.get("FLT") in _HARMLESS:
            return
        self.set(ACT=0)
        self._until("STA", 0, timeout)
        self.set(ACT=1)
        self._until("STA", ACTIVE, timeout)

    def calibrate(self, timeout: float = _ACTIVATION_S) -> None:
        """Open and close fully, with nothing between the fingers, and note what POS then reads."""
        self.move(linkage.STROKE, SPEEDS[0], FORCES[0])
        self.set(POS=0)
        GripperMotion(self).wait(timeout)
        opened = self.get("POS")
        self.set(POS=255)
        GripperMotion(self).wait(timeout)
        self.open_position, self.closed_position = opened, self.get("POS")

    @property
    def width(self) -> float:
        """Opening between the pads, m, measured to 0.6 mm."""
        return opening_of(self.get("POS"), self.open_position, self.closed_position)

    @property
    def is_holding(self) -> bool:
        """Whether the fingers were stopped by something while they closed. Raises GripperFault."""
        self.check()
        return self.get("OBJ") == 2

    def move(self, width: float, speed: float, force: float) -> GripperMotion:
        """To an opening, m, with m/s and N. Raises SpeedLimit for what it cannot do, GripperFault."""
        if not -1e-6 <= width <= linkage.STROKE + 1e-6:
            raise SpeedLimit(f"width={width} m: the gripper opens from 0 to {linkage.STROKE} m")
        values = {
            "POS": position_of(width, self.open_position, self.closed_position),
            "SPE": _share("speed", speed, SPEEDS, "m/s"),
            "FOR": _share("force", force, FORCES, "N"),
        }
        self.check()
        self.set(**values, GTO=1)
        return GripperMotion(self, values["POS"])

    def stop(self) -> None:
        """Stay where the fingers are."""
        self.set(GTO=0)

    def check(self) -> None:
        """Raises GripperFault where it is not activated or reports a fault."""
        fault = self.get("FLT")
        if fault not in _HARMLESS:
            what = FAULTS.get(fault, "unknown")
            raise GripperFault(f"{self._where}: fault {fault}, {what}; free the fingers, then activate()")
        if self.get("STA") != ACTIVE:
            raise GripperFault(f"{self._where} is not activated: activate(), with nothing between the fingers")

    def close(self) -> None:
        """End the connection; the fingers stay as they are."""
        self._socket.close()

    def _ask(self, line: str) -> str:
        """The answer to a line; one at a time."""
        with self._lock:
            try:
                self._socket.sendall(line.encode())
                while b"\n" not in self._rest:
                    received = self._socket.recv(1024)
                    if not received:
                        raise OSError("it has closed the connection")
                    self._rest += received
                    # The URCap ends what it says to SET without a line's end.
                    if self._rest.strip() in (b"ack", b"?"):
                        self._rest += b"\n"
            except OSError as error:
                self._socket.close()
                raise ConnectionLost(f"{self._where}: {error}; check the cable, then connect again") from error
            answer, _, self._rest = self._rest.partition(b"\n")
            return answer.decode(errors="replace").strip()

    def _until(self, name: str, value: int, timeout: float) -> None:
        deadline = time.monotonic() + timeout
        while self.get(name) != value:
            fault = self.get("FLT")
            if fault not in (*_HARMLESS, 5, 7):
                raise GripperFault(f"{self._where}: fault {fault}, {FAULTS.get(fault, 'unknown')}")
            if time.monotonic() > deadline:
                raise GripperFault(f"{self._where}: {name} is not {value} after {timeout} s; is the gripper powered?")
            time.sleep(_POLL_S)


class GripperMotion:
    """Fingers on their way to a position register (None: to wherever they were sent last)."""

    def __init__(self, gripper: RobotiqGripper, position: int | None = None) -> None:
        self._gripper, self._position = gripper, position

    @property
    def done(self) -> bool:
        """Arrived, or stopped by something."""
        # Until PRE echoes the wish, OBJ speaks of the motion before.
        if self._position is not None and self._gripper.get("PRE") != self._position:
            return False
        return self._gripper.get("OBJ") != 0

    def wait(self, timeout: float) -> None:
        deadline = time.monotonic() + timeout
        while not self.done:
            self._gripper.check()
            if time.monotonic() > deadline:
                raise MotionTimeout(f"the fingers are still on their way after {timeout} s")
            time.sleep(_POLL_S)
        self._gripper.check()

    def cancel(self) -> None:
        self._gripper.stop()


def _share(name: str, value: float, limits: tuple[float, float], unit: str) -> int:
    """0 … 255 between the limits. Raises SpeedLimit."""
    low, high = limits
    if not low - 1e-9 <= value <= high + 1e-9:
        raise SpeedLimit(f"{name}={value} {unit}: the gripper does {low} … {high} {unit}")
    return round(255 * (value - low) / (high - low))
