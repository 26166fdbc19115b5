"""The ports that take URScript, 30001, 30002 and 30003. `ur_rtde`'s program is understood, others are refused.

Who connects to one of the first two is told the arm's lengths, in the vendor's robot state message; a real one tells
its state ten times a second.
"""

from __future__ import annotations

import socket

from pecgrasp_env.real.fakes.control_script import ControlScript
from pecgrasp_env.real.fakes.controller import Controller
from pecgrasp_env.real.fakes.network import Connection, Network
from pecgrasp_env.real.ur_measured import HEADER, KINEMATICS_INFO, ROBOT_STATE, TABLE, table_of
from pecgrasp_env.robot.arm_lengths import ArmLengths

PORTS = (30001, 30002, 30003)
_LONGEST_BYTES = 1 << 20
_VERSION, _JOINT_DATA = 20, 1


def _message(kind: int, held: bytes) -> bytes:
    """A message or a sub-package of one."""
    return HEADER.pack(HEADER.size + len(held), kind) + held


def _kinematics_info(arm: ArmLengths) -> bytes:
    """The sub-packages of a state that lengths stand in; the joints' is left empty."""
    table = TABLE.pack(*[0] * 6, *table_of(arm).T.ravel(), 0)
    return _message(_JOINT_DATA, bytes(251)) + _message(KINEMATICS_INFO, table)


class ScriptConnection(Connection):
    """One client. A program is what stands between a `def` at a line's start and an `end` at a line's start."""

    def __init__(self, network: Network, client: socket.socket, controller: Controller) -> None:
        super().__init__(network, client)
        self._controller = controller
        self._text = ""
        if controller.tells_lengths and client.getsockname()[1] in PORTS[:2]:
            self.send(_message(_VERSION, bytes(8)) + _message(ROBOT_STATE, _kinematics_info(controller.plant.arm)))

    def received(self, data: bytes) -> None:
        self._text = (self._text + data.decode(errors="replace"))[-_LONGEST_BYTES:]
        while (end := self._text.find("\nend\n")) >= 0:
            program, self._text = self._text[: end + 5], self._text[end + 5 :]
            if "def rtde_control()" in program:
                self._controller.start(ControlScript(program, self._controller))
