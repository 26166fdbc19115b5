"""A whole stand-in: a UR controller with a Robotiq gripper, all its sockets, and the clock that drives them."""

from __future__ import annotations

import base64
import io
import json
import socket
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from pecgrasp_env.real.fakes import bench, dashboard_server, rtde_server, script_server
from pecgrasp_env.real.fakes.controller import CB3, Controller, Version
from pecgrasp_env.real.fakes.network import LineConnection, Network
from pecgrasp_env.real.fakes.plant import Plant
from pecgrasp_env.real.fakes.robotiq_server import FakeRobotiq, RobotiqConnection
from pecgrasp_env.real.robotiq import PORT as GRIPPER_PORT


class FakeRobot:
    """Serves a plant on a host's ports until it is told to stop.

    Args:
        plant: what moves.
        host: an address of this machine; each of 127.0.0.1, 127.0.0.2 … has all ports to itself.
        version: of the controller's software; major 3 is a CB3, 5 an e-Series.
        model: what the dashboard calls the arm.
        active: whether the gripper has been activated already.
        pace: simulated seconds a second, at most; a plant that cannot keep up slows the controller's clock down.

    Raises OSError where a port is taken.
    """

    def __init__(
        self,
        plant: Plant,
        host: str = "127.0.0.1",
        version: Version = CB3,
        model: str = "UR5",
        *,
        active: bool = False,
        pace: float = 1.0,
    ) -> None:
        self.plant = plant
        self.gripper = FakeRobotiq(active)
        self.controller = Controller(plant, self.gripper, version, pace)
        self.network = Network(host)
        self.network.cut_s = _CUT_PERIODS * self.controller.period / pace
        self.bench = Network(host)  # which no fault of the cable touches
        self.at_rest_since: float | None = None
        self.fault_at: float | None = None
        self._pace = pace
        self._stopped = False
        controller = self.controller
        self.network.listen(rtde_server.PORT, lambda n, c: rtde_server.RtdeConnection(n, c, controller))
        self.network.listen(
            dashboard_server.PORT, lambda n, c: dashboard_server.DashboardConnection(n, c, controller, model)
        )
        for port in script_server.PORTS:
            self.network.listen(port, lambda n, c: script_server.ScriptConnection(n, c, controller))
        self.network.listen(GRIPPER_PORT, lambda n, c: RobotiqConnection(n, c, self.gripper))
        self.bench.listen(bench.PORT, lambda n, c: BenchConnection(n, c, self))

    def run(self, on_step: Callable[[], None] | None = None) -> None:
        """Until `stop`, at the bench or from ``on_step``, which is called once a period."""
        due = time.monotonic()
        try:
            while not self._stopped:
                due = max(due + self.controller.period / self._pace, time.monotonic())
                self.bench.serve(0.0)
                self.network.serve(due)
                self.controller.tick()
                self._note_rest()
                for connection in self.network.connections:
                    if isinstance(connection, rtde_server.RtdeConnection):
                        connection.publish()
                if on_step is not None:
                    on_step()
        finally:
            self.network.close()
            self.bench.close()

    def stop(self) -> None:
        self._stopped = True

    def _note_rest(self) -> None:
        still = float(np.abs(self.controller.measured_rates).max()) < AT_REST_RAD_S
        if not still:
            self.at_rest_since = None
        elif self.at_rest_since is None:
            self.at_rest_since = self.controller.time

    def reset(self, seed: int) -> None:
        """The plant anew, no program, no faults, the gripper open and activated."""
        FAULTS["none"](self)
        self.plant.reset(seed)
        self.gripper.reset(self.plant.opening)
        self.controller.reset()
        self.fault_at = None

    def provoke(self, fault: str) -> None:
        """One of FAULTS, from now on. Raises KeyError for another, ValueError where the plant cannot have it."""
        act = FAULTS[fault]
        self.fault_at = self.controller.time
        act(self)


_CUT_PERIODS = 0.375
AT_REST_RAD_S = (
    0.05  # a quarter of what the task calls static: the simulated joints settle with a time constant of 50 ms
)


def _local(robot: FakeRobot) -> None:
    robot.controller.remote = False
    robot.controller.stop_program()


def _cable(attribute: str, value: Any) -> Callable[[FakeRobot], None]:
    return lambda robot: setattr(robot.network, attribute, value)


def _mended(robot: FakeRobot) -> None:
    robot.network.lag, robot.network.cut, robot.network.silent = 0.0, False, False
    robot.controller.protective = robot.controller.emergency = robot.gripper.stuck = False
    robot.controller.remote = True


FAULTS: dict[str, Callable[[FakeRobot], None]] = {
    "protective_stop": lambda robot: robot.controller.protective_stop(),
    "emergency_stop": lambda robot: robot.controller.emergency_stop(),
    "connection_silent": _cable("silent", True),  # the cable is pulled
    "connection_closed": lambda robot: robot.network.drop(),
    "program_stopped": lambda robot: robot.controller.stop_program(),  # somebody pressed stop on the pendant
    "local_mode": _local,
    "lag": _cable("lag", 0.05),
    "cut": _cable("cut", True),
    "gripper_reset": lambda robot: robot.gripper.write({"ACT": 0}),
    "gripper_stuck": lambda robot: setattr(robot.gripper, "stuck", True),
    "gripper_fault": lambda robot: robot.gripper.fail(8),
    "object_lost": lambda robot: robot.plant.drop(),  # once, and not mended: it slipped out of the fingers
    "objects_swapped": lambda robot: robot.plant.swap(),  # once: somebody reached in
    "none": _mended,
}


class BenchConnection(LineConnection):
    """Lines of JSON: {"fault": name}, {"reset": seed}, {"ask": "state"}, {"ask": "depth"}, with {"from":
    T_base_camera} of a camera beside the robot, {"ask": "stop"}."""

    def __init__(self, network: Network, client: socket.socket, robot: FakeRobot) -> None:
        super().__init__(network, client)
        self._robot = robot

    def answer(self, line: str) -> bytes:
        return (json.dumps(self._answer(json.loads(line))) + "\n").encode()

    def _answer(self, wish: dict[str, Any]) -> dict[str, Any]:
        robot = self._robot
        if "fault" in wish:
            if wish["fault"] not in FAULTS:
                return {"error": f"no fault {wish['fault']!r}; there are {', '.join(FAULTS)}"}
            try:
                robot.provoke(wish["fault"])
            except ValueError as error:
                return {"error": str(error)}
        if "reset" in wish:
            robot.reset(int(wish["reset"]))
        if wish.get("ask") == "stop":
            robot.stop()
        if wish.get("ask") == "depth":
            return self._frame(wish.get("from"))
        controller = robot.controller
        return {
            "time": controller.time,
            "fault_at": robot.fault_at,
            "at_rest_since": robot.at_rest_since,
            "q": [float(each) for each in controller.measured],
            "opening": float(robot.plant.opening),
            "program": controller.program is not None,
            "clients": len(robot.network.connections),
            **robot.plant.report(),
        }

    def _frame(self, where: list[list[float]] | None) -> dict[str, Any]:
        try:
            depth, K = self._robot.plant.grab(None if where is None else np.array(where, float))
        except ValueError as error:
            return {"error": str(error)}
        packed = io.BytesIO()
        np.save(packed, depth)
        return {
            "time": self._robot.controller.time,
            "intrinsics": [K.width, K.height, K.fx, K.fy, K.cx, K.cy],
            "depth": base64.b64encode(packed.getvalue()).decode(),
        }
