"""The bench at which a stand-in lies: its faults are provoked there, and its camera is read; no vendor has one."""

from __future__ import annotations

import base64
import io
import json
import socket
from typing import Any

import numpy as np

from pecgrasp_env.real.errors import ConnectionLost
from pecgrasp_env.real.interfaces import DepthImage
from pecgrasp_env.robot.camera_mount import read_mount
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

PORT = 30100
_ANSWER_S = 60.0  # a reset draws and settles new objects


class Bench:
    """A client of a `FakeRobot`. Raises ConnectionLost where there is none."""

    def __init__(self, host: str) -> None:
        try:
            self._socket = socket.create_connection((host, PORT), timeout=_ANSWER_S)
        except OSError as error:
            raise ConnectionLost(f"no stand-in at {host}:{PORT}: {error}; start pecgrasp fake-robot") from error
        self._host = host
        self._lines = self._socket.makefile("rw")

    def ask(self, **wish: Any) -> dict[str, Any]:
        """What `BenchConnection` answers. Raises ValueError with its error, ConnectionLost where none comes."""
        try:
            self._lines.write(json.dumps(wish) + "\n")
            self._lines.flush()
            answer: dict[str, Any] = json.loads(self._lines.readline())
        except (OSError, ValueError) as error:
            raise ConnectionLost(f"the stand-in at {self._host} gave no answer: {error}") from error
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    def provoke(self, fault: str) -> None:
        """One of `fake_robot.FAULTS`; "none" mends all."""
        self.ask(fault=fault)

    @property
    def state(self) -> dict[str, Any]:
        """time and fault_at, at_rest_since (s of the controller's clock, None: moving), q, opening, and the plant's."""
        return self.ask(ask="state")

    def close(self) -> None:
        self._lines.close()  # which would hold the connection open
        self._socket.close()


class BenchCamera:
    """A simulated camera of a stand-in, as a DepthCamera: on its wrist, or beside it where ``beside``, a file of
    `pecgrasp calibrate … parent=base`, says.
    """

    def __init__(self, host: str, beside: str | None = None) -> None:
        where = {} if beside is None else {"from": read_mount(beside, "base").tolist()}
        self._wish: dict[str, Any] = {"ask": "depth", **where}
        self._bench = Bench(host)

    def grab(self) -> DepthImage:
        """A frame of this moment."""
        answer = self._bench.ask(**self._wish)
        width, height, *rest = answer["intrinsics"]
        depth = np.load(io.BytesIO(base64.b64decode(answer["depth"])))
        return DepthImage(depth, CameraIntrinsics(int(width), int(height), *rest), answer["time"])

    def close(self) -> None:
        self._bench.close()
