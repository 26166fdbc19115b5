"""The dashboard of a UR controller, port 29999: lines of text that switch it on and off, and say how it is."""

from __future__ import annotations

import socket

from pecgrasp_env.real.fakes.controller import Controller
from pecgrasp_env.real.fakes.network import LineConnection, Network

PORT = 29999
_SAFETY = {1: "NORMAL", 3: "PROTECTIVE_STOP", 7: "ROBOT_EMERGENCY_STOP"}


class DashboardConnection(LineConnection):
    """One client."""

    def __init__(self, network: Network, client: socket.socket, controller: Controller, model: str) -> None:
        super().__init__(network, client)
        self._controller, self._model = controller, model
        self.send(b"Connected: Universal Robots Dashboard Server\n")

    def answer(self, line: str) -> bytes:
        return (self._said(line) + "\n").encode()

    def _said(self, line: str) -> str:
        controller = self._controller
        running = controller.program is not None
        if line == "stop":
            controller.stop_program()
            return "Stopped"
        if line == "unlock protective stop":
            return "Protective stop releasing" if controller.unlock() else "Cannot unlock protective stop"
        e_series = controller.version.major > 3
        remote = str(controller.remote).lower() if e_series else "could not understand: 'is in remote control'"
        mode = "POWER_OFF" if controller.emergency else "RUNNING"
        answers = {
            "PolyscopeVersion": controller.version.polyscope,
            "running": f"Program running: {str(running).lower()}",
            "programState": f"{'PLAYING' if running else 'STOPPED'} rtde_control",
            "robotmode": f"Robotmode: {mode}",
            "safetymode": f"Safetymode: {_SAFETY[controller.safety_mode]}",
            "safetystatus": f"Safetystatus: {_SAFETY[controller.safety_mode]}",
            "is in remote control": remote,
            "get robot model": self._model,
            "get serial number": "20195500000",
            "power on": "Powering on",
            "power off": "Powering off",
            "brake release": "Brake releasing",
            "close popup": "closing popup",
            "close safety popup": "closing safety popup",
            "restart safety": "Restarting safety",
            "quit": "Disconnected",
        }
        return answers.get(line, f"could not understand: '{line}'")
