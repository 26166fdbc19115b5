"""A Robotiq 2F-140 and its URCap: the registers of `pecgrasp_env.real.robotiq`, served on port 63352."""

from __future__ import annotations

import socket

import numpy as np

from pecgrasp_env.real.fakes.network import LineConnection, Network
from pecgrasp_env.real.robotiq import ACTIVE, FORCES, SPEEDS, opening_of, position_of
from pecgrasp_env.robot.gripper_linkage import STROKE

OPEN_POSITION, CLOSED_POSITION = 3, 230
_ACTIVATION_S = 0.8
_STILL_S = 0.15  # so long the fingers must stand still for the gripper to say that something stops them
_STILL_M = 0.0005
_LEAD_M = 0.025  # that the motor's wish is ahead of fingers that something stops
_READABLE = ("ACT", "GTO", "POS", "SPE", "FOR", "PRE", "STA", "OBJ", "FLT")
_WRITABLE = ("ACT", "GTO", "POS", "SPE", "FOR", "ATR", "ARD")


class FakeRobotiq:
    """The gripper's registers and what its motor is told; `opening` and `force` are what the plant is to do.

    stuck: a finger does not move, which ends in fault 14. It starts switched on and not activated, fully open.
    """

    def __init__(self, active: bool = False) -> None:
        self.reset(STROKE, active)

    def reset(self, opening: float, active: bool = True) -> None:
        """As after it was switched on, the fingers at an opening, m."""
        self.registers = dict.fromkeys({*_READABLE, *_WRITABLE}, 0)
        self.stuck = False
        self.opening, self.force = opening, FORCES[0]
        self._measured = self._goal = opening
        self._closes = False
        self._still = 0.0
        self._activating: float | None = None
        if active:
            position = position_of(opening, OPEN_POSITION, CLOSED_POSITION)
            self.registers |= {"ACT": 1, "STA": ACTIVE, "OBJ": 3, "POS": position, "PRE": position}

    def fail(self, fault: int) -> None:
        """Report a fault, 5 … 15, and let go of the motor until it is activated anew."""
        self.registers |= {"FLT": fault, "STA": 0, "ACT": 0, "GTO": 0}
        self._stop()

    def write(self, registers: dict[str, int]) -> None:
        """What `SET` does."""
        before = dict(self.registers)
        for name, value in registers.items():
            if name != "POS":
                self.registers[name] = value
        if "ACT" in registers and registers["ACT"] != before["ACT"]:
            self.registers |= {"STA": 0, "FLT": 0, "OBJ": 0, "GTO": 0}
            self._activating = _ACTIVATION_S if registers["ACT"] else None
            self.registers["STA"] = 1 if registers["ACT"] else 0
            self._stop()
        if "POS" in registers:
            self.registers["PRE"] = registers["POS"]
        if self.registers["GTO"] and ("POS" in registers or not before["GTO"]):
            self._go()
        if before["GTO"] and not self.registers["GTO"]:
            self._stop()

    def _go(self) -> None:
        if self.registers["STA"] != ACTIVE:
            self.registers["FLT"] = 5 if self.registers["STA"] == 1 else 7
            return
        # Beyond its ends the register asks for what the fingers cannot do.
        wish = int(np.clip(self.registers["PRE"], OPEN_POSITION, CLOSED_POSITION))
        goal = opening_of(wish, OPEN_POSITION, CLOSED_POSITION)
        if abs(goal - self._measured) > _STILL_M:
            self._closes = goal < self._measured
            self.registers["OBJ"] = 0
        self._goal, self._still = goal, 0.0

    def _stop(self) -> None:
        self._goal = self.opening = self._measured

    def step(self, measured: float, dt: float) -> None:
        """One step of the motor, after the plant has moved: measured opening, m."""
        moved = abs(measured - self._measured)
        self._measured = measured
        self.registers["POS"] = position_of(max(measured, 0.0), OPEN_POSITION, CLOSED_POSITION)
        if self._activating is not None:
            self._activating -= dt
            if self._activating <= 0:
                self._activating = None
                self.registers |= {"STA": ACTIVE, "OBJ": 3}
            return
        low, high = SPEEDS
        speed = low + self.registers["SPE"] / 255 * (high - low)
        self.force = FORCES[0] + self.registers["FOR"] / 255 * (FORCES[1] - FORCES[0])
        if self.stuck and abs(self._goal - measured) > _STILL_M:
            self._still += dt
            if self._still > _STILL_S:
                self.fail(14)
            return
        start = float(np.clip(self.opening, measured - _LEAD_M, measured + _LEAD_M))
        self.opening = start + float(np.clip(self._goal - start, -speed * dt, speed * dt))
        stands = moved < _STILL_M * dt / _STILL_S
        if stands and abs(self._goal - measured) <= 2 * _STILL_M:
            self.registers["OBJ"] = 3
        elif stands:
            self._still += dt
            if self._still > _STILL_S:
                self.registers["OBJ"] = 2 if self._closes else 1
        else:
            self._still = 0.0


class RobotiqConnection(LineConnection):
    """One client of the URCap."""

    def __init__(self, network: Network, client: socket.socket, gripper: FakeRobotiq) -> None:
        super().__init__(network, client)
        self._gripper = gripper

    def answer(self, line: str) -> bytes:
        words = line.split()
        if len(words) == 2 and words[0] == "GET" and words[1] in _READABLE:
            return f"{words[1]} {self._gripper.registers[words[1]]}\n".encode()
        names, values = words[1::2], words[2::2]
        known = all(name in _WRITABLE for name in names) and all(v.isdigit() and int(v) < 256 for v in values)
        if words[:1] == ["SET"] and names and len(names) == len(values) and known:
            self._gripper.write(dict(zip(names, map(int, values), strict=True)))
            return b"ack"
        return b"?"
