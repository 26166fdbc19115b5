"""The ports that take URScript, 30001, 30002 and 30003. `ur_rtde`'s program is understood, others are refused."""

from __future__ import annotations

import socket

from pecgrasp_env.real.fakes.control_script import ControlScript
from pecgrasp_env.real.fakes.controller import Controller
from pecgrasp_env.real.fakes.network import Connection, Network

PORTS = (30001, 30002, 30003)
_LONGEST_BYTES = 1 << 20


class ScriptConnection(Connection):
    """One client. A program is what stands between a `def` at a line's start and an `end` at a line's start."""

    def __init__(self, network: Network, client: socket.socket, controller: Controller) -> None:
        super().__init__(network, client)
        self._controller = controller
        self._text = ""

    def received(self, data: bytes) -> None:
        self._text = (self._text + data.decode(errors="replace"))[-_LONGEST_BYTES:]
        while (end := self._text.find("\nend\n")) >= 0:
            program, self._text = self._text[: end + 5], self._text[end + 5 :]
            if "def rtde_control()" in program:
                self._controller.start(ControlScript(program, self._controller))
