"""The way to a real arm, gripper and camera, beside what their libraries do alone: loop rates and latencies.

Against stand-ins on this machine, an arm that follows exactly and librealsense's software device; what a network and a
controller add is not in it. Needs the extras `ur` and `realsense`.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from itertools import cycle
from typing import Any

import numpy as np

from pecgrasp_env.benchmark.timing import Row, Timing, rows_of, side_by_side
from pecgrasp_env.real.camera.realsense import RealSenseCamera, realsense
from pecgrasp_env.real.errors import library
from pecgrasp_env.real.fakes.own_process import StandIn
from pecgrasp_env.real.fakes.plant import FollowingJoints
from pecgrasp_env.real.fakes.realsense_device import SoftwareRealSense
from pecgrasp_env.real.joint_stream import PERIOD
from pecgrasp_env.real.robotiq import PORT, RobotiqGripper
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.robot.kinematics import HOME
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_TURN = 0.01 * np.eye(6)[0]  # rad, a command's
_MOVED_RAD = 1e-4
_STATES = 50  # in a row: one alone comes when the machine lets it
_PATIENCE_S = 60.0
_CAMERA = CameraIntrinsics(848, 480, 421.0, 421.0, 424.0, 240.0)


def robot(settings: Mapping[str, Any]) -> list[Row]:
    """Periods and commands of an arm, registers of a gripper, frames of a camera: ours beside the libraries' own.

    Raises MissingExtra.
    """
    library("rtde_control", "ur")
    realsense()
    repeats = settings["repeats"]
    with ExitStack() as stack:
        ours, theirs = (stack.enter_context(_stand_in()) for _ in range(2))
        rows = _arm_rows(stack, ours, theirs, repeats)
        rows += _gripper_rows(stack, ours, repeats)
    return rows + _camera_rows(repeats)


@contextmanager
def _stand_in() -> Iterator[str]:
    stand_in = StandIn(FollowingJoints)
    try:
        yield stand_in.host
    finally:
        stand_in.close()


def _arm_rows(stack: ExitStack, ours: str, theirs: str, repeats: int) -> list[Row]:
    arm = URArm(ours, patience=_PATIENCE_S)
    stack.callback(arm.close)
    receive = library("rtde_receive", "ur").RTDEReceiveInterface(theirs)
    control = library("rtde_control", "ur").RTDEControlInterface(theirs)
    stack.callback(receive.disconnect)
    stack.callback(control.disconnect)
    stack.callback(control.stopScript)
    ends = cycle([HOME + _TURN, HOME])

    def our_command() -> None:
        start, motion = arm.state.q, arm.follow(next(ends), PERIOD)
        _until(lambda: np.abs(arm.state.q - start).max() > _MOVED_RAD)
        motion.wait(_PATIENCE_S)

    def their_command() -> None:
        start = np.array(receive.getActualQ())
        control.servoJ(
            (start + _TURN).tolist() if start[0] < HOME[0] + 0.005 else HOME.tolist(), 0, 0, PERIOD, 0.03, 300
        )
        _until(lambda: np.abs(np.array(receive.getActualQ()) - start).max() > _MOVED_RAD)

    periods = {
        "ur_rtde, its receiver": lambda: _until_changed(receive.getTimestamp, _STATES),
        "URArm.state": lambda: _until_changed(lambda: arm.state.time, _STATES),
    }
    commands = {"ur_rtde, servoJ": their_command, "URArm.follow": our_command}
    whole = side_by_side(periods, max(1, repeats // 5))
    one = {name: Timing(each.wall / _STATES, each.cpu / _STATES) for name, each in whole.items()}
    return [
        *rows_of(one, "ur_rtde, its receiver", "arm: a state, of 125 a second", "Hz"),
        *rows_of(side_by_side(commands, repeats), "ur_rtde, servoJ", "arm: from a command until it moves", "Hz"),
    ]


def _gripper_rows(stack: ExitStack, host: str, repeats: int) -> list[Row]:
    gripper = RobotiqGripper(host)
    stack.callback(gripper.close)
    bare = stack.enter_context(socket.create_connection((host, PORT)))
    bare.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def their_register() -> None:
        bare.sendall(b"GET POS\n")
        bare.recv(64)

    registers = {"a bare socket": their_register, "RobotiqGripper.width": lambda: gripper.width}
    return rows_of(side_by_side(registers, repeats), "a bare socket", "gripper: its opening", "Hz")


def _camera_rows(repeats: int) -> list[Row]:
    """At 30 frames a second; the mean of eight frames takes eight of them, whoever takes it."""
    rs = realsense()
    depth = np.full((_CAMERA.height, _CAMERA.width), 0.55, np.float32)
    with ExitStack() as stack:
        devices = [SoftwareRealSense(lambda: depth, _CAMERA) for _ in range(3)]
        sensor, queue = devices[0].device.first_depth_sensor(), rs.frame_queue(1)
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(queue)
        stack.callback(sensor.close)
        stack.callback(sensor.stop)

        def their_frame() -> None:
            while queue.poll_for_frame():
                pass
            queue.wait_for_frame()

        frames: dict[str, Callable[[], Any]] = {"pyrealsense2": their_frame}
        for device, n in zip(devices[1:], (1, 8), strict=True):
            camera = stack.enter_context(RealSenseCamera(device.device, frames=n))
            frames[f"RealSenseCamera, frames={n}"] = camera.grab
        for device in devices:
            stack.callback(device.run().close)
        times = side_by_side(frames, repeats)
    return rows_of(times, "pyrealsense2", "camera: a frame after the call, 848x480", "Hz")


def _until(holds: Callable[[], Any]) -> None:
    deadline = time.monotonic() + _PATIENCE_S
    while not holds():
        if time.monotonic() > deadline:
            raise RuntimeError(f"nothing moved for {_PATIENCE_S} s")
        time.sleep(0.0002)


def _until_changed(value: Callable[[], float], times: int) -> None:
    for _ in range(times):
        before = value()
        _until(lambda before=before: value() != before)  # type: ignore[misc]
