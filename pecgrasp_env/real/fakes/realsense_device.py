"""A RealSense camera that is none: librealsense's own software device, fed with depth frames from elsewhere.

The driver opens it as it would a D435; the library's streams, filters, intrinsics and depth unit are the real ones.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from pecgrasp_env.real.camera.realsense import realsense
from pecgrasp_env.sensor.intrinsics import BASELINE, CameraIntrinsics

_FPS = 30


class SoftwareRealSense:
    """`device` is what `RealSenseCamera(device)` takes.

    Args:
        take: depth (H, W) m, 0 or NaN for none, of each next frame.
        intrinsics: of these.
        depth_unit: m, in which the device gives depth.
        infrared: takes an image (H, W) uint8 of the left imager; None: it has no such stream.
        rate: frames a second; 0: as fast as they are taken.
    """

    def __init__(
        self,
        take: Callable[[], np.ndarray],
        intrinsics: CameraIntrinsics,
        depth_unit: float = 1e-3,
        infrared: Callable[[], np.ndarray] | None = None,
        rate: float = 30.0,
    ) -> None:
        rs = realsense()
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.name, "software D435")
        self._take, self._infrared, self._unit = take, infrared, depth_unit
        self._sensor = self.device.add_sensor("Stereo Module")
        self._depth = self._sensor.add_video_stream(_stream(intrinsics, rs.stream.depth, 0, rs.format.z16, 2))
        streams = [] if infrared is None else [_stream(intrinsics, rs.stream.infrared, 1, rs.format.y8, 1)]
        self._grey = [self._sensor.add_video_stream(each) for each in streams]
        self._sensor.add_read_only_option(rs.option.depth_units, depth_unit)
        self._sensor.add_read_only_option(rs.option.stereo_baseline, 1e3 * BASELINE)
        self._pause = 1 / rate if rate else 0.0
        self._number = 0
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def run(self) -> SoftwareRealSense:
        """Sends frames from a thread until `close`; the device must be open to receive them."""
        self._thread = threading.Thread(target=self._send_all, daemon=True)
        self._thread.start()
        return self

    def send(self) -> None:
        """One frame of each stream."""
        self._number += 1
        depth = np.nan_to_num(np.asarray(self._take(), np.float64))
        units = np.clip(np.rint(depth / self._unit), 0, np.iinfo(np.uint16).max).astype(np.uint16)
        self._hand_over(self._depth, units)
        for stream in self._grey:
            assert self._infrared is not None
            self._hand_over(stream, np.asarray(self._infrared(), np.uint8))

    def close(self) -> None:
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _send_all(self) -> None:
        while not self._ended.wait(self._pause):
            self.send()

    def _hand_over(self, stream: Any, pixels: np.ndarray) -> None:
        rs = realsense()
        frame = rs.software_video_frame()
        frame.pixels = np.ascontiguousarray(pixels)
        frame.bpp = pixels.itemsize
        frame.stride = pixels.itemsize * pixels.shape[1]
        frame.timestamp = 1e3 * self._number / _FPS
        frame.domain = rs.timestamp_domain.hardware_clock
        frame.frame_number = self._number
        frame.profile = stream.as_video_stream_profile()
        frame.depth_units = self._unit
        self._sensor.on_video_frame(frame)


def _stream(camera: CameraIntrinsics, kind: Any, index: int, form: Any, size: int) -> Any:
    rs = realsense()
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy = camera.width, camera.height, camera.fx, camera.fy
    lens.ppx, lens.ppy = camera.cx - 0.5, camera.cy - 0.5
    lens.model, lens.coeffs = rs.distortion.none, [0.0] * 5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.bpp = kind, index, index + 1, form, size
    stream.width, stream.height, stream.fps, stream.intrinsics = camera.width, camera.height, _FPS, lens
    return stream
