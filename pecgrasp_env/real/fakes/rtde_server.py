"""The Real-Time Data Exchange of a UR controller, protocol version 2, port 30004.

A packet is its length (two bytes, the header's three included), its kind (one byte) and what it holds, big-endian. Of
the kinds: `V` asks for a protocol version, `v` for the controller's, `O` and `I` set up what is sent and received, `S`
and `P` start and pause the sending, `U` is data, `M` a text. Names and types: Universal Robots' RTDE guide.
"""

from __future__ import annotations

import re
import socket
import struct
from collections.abc import Callable

import numpy as np

from pecgrasp_env.real.fakes.controller import Controller
from pecgrasp_env.real.fakes.network import Connection, Network

PORT = 30004
_HEADER = struct.Struct(">HB")
_LETTERS = {"DOUBLE": "d", "INT32": "i", "UINT32": "I", "UINT64": "Q", "UINT8": "B", "BOOL": "?"}
_VECTORS = {"VECTOR6D": "6d", "VECTOR3D": "3d", "VECTOR6INT32": "6i"}
_REGISTER = re.compile(r"(input|output)_(int|double)_register_(\d+)$")
# What a client may set besides registers.
_INPUTS = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
}
_Value = Callable[[Controller], object]
_OUTPUTS: dict[str, tuple[str, _Value]] = {
    "timestamp": ("DOUBLE", lambda c: c.time),
    "target_q": ("VECTOR6D", lambda c: c.target),
    "target_qd": ("VECTOR6D", lambda c: c.rates),
    "actual_q": ("VECTOR6D", lambda c: c.measured),
    "actual_qd": ("VECTOR6D", lambda c: c.measured_rates),
    "actual_TCP_pose": ("VECTOR6D", lambda c: c.tool_pose(c.measured)),
    "target_TCP_pose": ("VECTOR6D", lambda c: c.tool_pose(c.target)),
    "robot_mode": ("INT32", lambda c: c.robot_mode),
    "joint_mode": ("VECTOR6INT32", lambda c: [253] * 6),
    "safety_mode": ("INT32", lambda c: c.safety_mode),
    "speed_scaling": ("DOUBLE", lambda c: 1.0),
    "target_speed_fraction": ("DOUBLE", lambda c: c.speed_fraction),
    "runtime_state": ("UINT32", lambda c: c.runtime_state),
    "robot_status_bits": ("UINT32", lambda c: c.robot_status),
    "safety_status_bits": ("UINT32", lambda c: c.safety_status),
    "payload": ("DOUBLE", lambda c: c.payload[0]),
    "payload_cog": ("VECTOR3D", lambda c: c.payload[1]),
    "actual_main_voltage": ("DOUBLE", lambda c: 48.0),
    "actual_robot_voltage": ("DOUBLE", lambda c: 48.0),
    "actual_digital_input_bits": ("UINT64", lambda c: 0),
    "actual_digital_output_bits": ("UINT64", lambda c: 0),
}
# What the stand-in has no idea of, and answers with zeros.
_ZEROS = {
    "VECTOR6D": (
        "target_qdd target_current target_moment actual_current joint_control_output actual_TCP_speed actual_TCP_force "
        "target_TCP_speed joint_temperatures actual_joint_voltage payload_inertia ft_raw_wrench"
    ),
    "VECTOR3D": "actual_tool_accelerometer",
    "DOUBLE": (
        "actual_execution_time actual_momentum actual_robot_current standard_analog_input0 standard_analog_input1 "
        "standard_analog_output0 standard_analog_output1 speed_scaling_combined"
    ),
}
_NOTHING = {"VECTOR6D": [0.0] * 6, "VECTOR3D": [0.0] * 3, "DOUBLE": 0.0}


def _always(value: object) -> _Value:
    return lambda c: value


def _output(name: str) -> tuple[str, _Value] | None:
    """Type and value of an output; None where there is none of that name."""
    if name in _OUTPUTS:
        return _OUTPUTS[name]
    for kind, names in _ZEROS.items():
        if name in names.split():
            return kind, _always(_NOTHING[kind])
    match = _REGISTER.match(name)
    if match is None or int(match[3]) > 47:
        return None
    index, way = int(match[3]), match[1]
    if match[2] == "int":
        return "INT32", lambda c: (c.integers_out if way == "output" else c.integers_in)[index]
    return "DOUBLE", lambda c: (c.doubles_out if way == "output" else c.doubles_in)[index]


def _input_type(name: str) -> str | None:
    match = _REGISTER.match(name)
    if match is not None and match[1] == "input" and int(match[3]) < 48:
        return "INT32" if match[2] == "int" else "DOUBLE"
    return _INPUTS.get(name)


def _letters(kind: str) -> str:
    return _VECTORS.get(kind) or _LETTERS[kind]


class RtdeConnection(Connection):
    """One client: what it wants to be told, what it writes, and whether it listens."""

    def __init__(self, network: Network, client: socket.socket, controller: Controller) -> None:
        super().__init__(network, client)
        self._controller = controller
        self._rest = b""
        self._outputs: list[_Value] = []
        self._packer = struct.Struct(">B")
        self._recipes: dict[int, tuple[list[str], struct.Struct]] = {}
        self._every, self._waited = 1, 0
        self._sends = False

    def received(self, data: bytes) -> None:
        self._rest += data
        while len(self._rest) >= _HEADER.size:
            size, kind = _HEADER.unpack_from(self._rest)
            if len(self._rest) < size:
                return
            held, self._rest = self._rest[_HEADER.size : size], self._rest[size:]
            self._packet(chr(kind), held)

    def _packet(self, kind: str, held: bytes) -> None:
        version = self._controller.version
        if kind == "V":
            self._answer(kind, struct.pack(">?", struct.unpack(">H", held)[0] == 2))
        elif kind == "v":
            self._answer(kind, struct.pack(">4I", version.major, version.minor, 0, 0))
        elif kind == "O":
            self._answer(kind, self._set_up_outputs(struct.unpack(">d", held[:8])[0], held[8:].decode()))
        elif kind == "I":
            self._answer(kind, self._set_up_inputs(held.decode()))
        elif kind in "SP":
            self._sends = kind == "S"
            self._answer(kind, b"\x01")
        elif kind == "U":
            self._write(held)

    def _answer(self, kind: str, held: bytes) -> None:
        self.send(_HEADER.pack(_HEADER.size + len(held), ord(kind)) + held)

    def _set_up_outputs(self, frequency: float, names: str) -> bytes:
        found = [_output(name) for name in names.rstrip(",").split(",")]
        known = [each for each in found if each is not None]
        self._outputs = [value for _, value in known]
        self._packer = struct.Struct(">B" + "".join(_letters(kind) for kind, _ in known))
        self._every = max(1, round(1 / (frequency * self._controller.period))) if frequency > 0 else 1
        types = ",".join("NOT_FOUND" if each is None else each[0] for each in found)
        return (b"\x01" if len(known) == len(found) else b"\x00") + types.encode()

    def _set_up_inputs(self, names: str) -> bytes:
        wanted = names.rstrip(",").split(",")
        types = [_input_type(name) or "NOT_FOUND" for name in wanted]
        if "NOT_FOUND" in types:
            return b"\x00" + ",".join(types).encode()
        recipe = len(self._recipes) + 1
        self._recipes[recipe] = wanted, struct.Struct(">" + "".join(_letters(kind) for kind in types))
        return bytes([recipe]) + ",".join(types).encode()

    def _write(self, held: bytes) -> None:
        """A data packet of a client: its recipe, then the values."""
        if held[:1] == b"" or held[0] not in self._recipes:
            return
        names, packer = self._recipes[held[0]]
        if len(held) != 1 + packer.size:
            return
        controller = self._controller
        values = dict(zip(names, packer.unpack(held[1:]), strict=False))
        for name, value in values.items():
            match = _REGISTER.match(name)
            if match is not None and match[2] == "int":
                controller.integers_in[int(match[3])] = value
                controller.word_from_client(int(match[3]))
            elif match is not None:
                controller.doubles_in[int(match[3])] = value
        if values.get("speed_slider_mask"):
            controller.speed_fraction = float(np.clip(values["speed_slider_fraction"], 0.0, 1.0))

    def publish(self) -> None:
        """Once a period: what the client wants to be told, as often as it wants."""
        self._waited += 1
        if not self._sends or self._waited < self._every:
            return
        self._waited = 0
        values: list[object] = [1]
        for value in self._outputs:
            now = value(self._controller)
            values += list(now) if isinstance(now, (list, np.ndarray)) else [now]
        self._answer("U", self._packer.pack(*values))
