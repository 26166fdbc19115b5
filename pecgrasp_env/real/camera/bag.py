"""Depth frames of a ROS bag as a camera: ROS 1 .bag, ROS 2 folders with SQLite or MCAP.

Read by `rosbags`, without ROS. A frame is a sensor_msgs/Image of 16UC1, millimetres, or 32FC1, metres (REP 118); its
intrinsics are the sensor_msgs/CameraInfo of the same camera, whose K counts from the first pixel's centre.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from grasping.cloud_files.depth_frame import checked_intrinsics
from grasping.errors import CloudError
from pecgrasp_env.real.errors import ConnectionLost, RobotError, library
from pecgrasp_env.real.interfaces import DepthImage
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_UNITS = {"16UC1": ("u2", 1e-3), "mono16": ("u2", 1e-3), "32FC1": ("f4", 1.0)}


class BagCamera:
    """Fulfils `DepthCamera`: each `grab` is the next frame.

    topic: of the depth images; None: the only one, or the only one with "depth" in its name. Raises RobotError for a
    bag that has no such topic or more than one, MissingExtra without `rosbags`.
    """

    def __init__(self, path: str | Path, topic: str | None = None) -> None:
        reader: Any = library("rosbags.highlevel", "rosbags").AnyReader
        types: Any = library("rosbags.typesys", "rosbags")
        if not Path(path).exists():
            raise RobotError(f"{path}: there is no such bag")
        try:
            # Bags of older ROS 2 do not say what their messages are made of.
            self._bag = reader([Path(path)], default_typestore=types.get_typestore(types.Stores.ROS2_HUMBLE))
            self._bag.open()
        except Exception as error:  # rosbags has one error a format, and no common one
            raise RobotError(f"{path}: {error}") from error
        try:
            self.topic = _depth_topic(self._bag, topic, path)
            self.intrinsics = _camera_info(self._bag, self.topic, path)
        except RobotError:
            self._bag.close()
            raise
        connections = [each for each in self._bag.connections if each.topic == self.topic]
        self._messages = self._bag.messages(connections=connections)
        self._open = True

    def grab(self) -> DepthImage:
        """Raises ConnectionLost after the last frame, RobotError for an image of another kind."""
        try:
            connection, _, raw = next(self._messages)
        except StopIteration:
            raise ConnectionLost(f"{self.topic}: the bag has no more frames") from None
        message = self._bag.deserialize(raw, connection.msgtype)
        time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        return DepthImage(_depth(message, self.topic), self.intrinsics, time)

    def close(self) -> None:
        if self._open:
            self._open = False
            self._bag.close()


def _depth_topic(bag: Any, wanted: str | None, path: str | Path) -> str:
    images = sorted({each.topic for each in bag.connections if each.msgtype == "sensor_msgs/msg/Image"})
    chosen = [wanted] if wanted is not None else [each for each in images if "depth" in each] or images
    if len(chosen) != 1 or chosen[0] not in images:
        raise RobotError(
            f"{path}: topic={wanted}: say which of its images is depth: {', '.join(images) or 'it has none'}"
        )
    return chosen[0]


def _camera_info(bag: Any, topic: str, path: str | Path) -> CameraIntrinsics:
    """Of the topic beside the images', as ROS names it."""
    name = topic.rpartition("/")[0] + "/camera_info"
    connections = [each for each in bag.connections if each.topic == name]
    for connection, _, raw in bag.messages(connections=connections) if connections else ():
        info = bag.deserialize(raw, connection.msgtype)
        K = np.asarray(getattr(info, "k", None) if hasattr(info, "k") else info.K, float).reshape(3, 3)
        try:
            K = checked_intrinsics(K, (info.height, info.width), f"{name}'s K")
        except CloudError as error:
            raise RobotError(f"{path}: {error}") from error
        return CameraIntrinsics(info.width, info.height, K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5)
    raise RobotError(f"{path}: no {name}: the intrinsics of {topic} are wanted")


def _depth(message: Any, topic: str) -> np.ndarray:
    """(H, W) float32 m, 0 for none."""
    if message.encoding not in _UNITS:
        raise RobotError(f"{topic}: encoding {message.encoding}: depth is {', '.join(_UNITS)}")
    kind, unit = _UNITS[message.encoding]
    numbers = np.dtype((">" if message.is_bigendian else "<") + kind)
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.step)
    image = np.ascontiguousarray(rows[:, : message.width * numbers.itemsize]).view(numbers)
    metres = image.astype(np.float32) * np.float32(unit)
    return np.where(np.isfinite(metres) & (metres > 0), metres, np.float32(0))
