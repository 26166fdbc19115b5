"""A RealSense D400 camera through librealsense, for depth frames that a planner is to trust.

What is set, and why (docs/cameras.md has the measurements):

- spatial filter in disparity, where the noise is even: it halves the noise of surfaces, and an edge of more than
  `spatial_delta` disparity steps stays as it is;
- no temporal filter, but the mean of `frames` frames, since the arm stands still while it looks: a filter that
  remembers would carry the last view into this one;
- **no hole filling**: what was not measured may be anything, the planner treats it as unknown (`Scene.unseen`), and a
  filter would put a surface there;
- no decimation, no threshold: the segmenter does without.

Depth, intrinsics and the depth unit are the device's own; nothing is assumed of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pecgrasp_env.real.camera.averaging import mean_depth
from pecgrasp_env.real.errors import ConnectionLost, MissingExtra, RobotError, library
from pecgrasp_env.real.interfaces import DepthImage
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_SYSTEM = "pyrealsense2 is there, but not libusb-1.0, which it needs: apt-get install libusb-1.0-0"
_WAIT_MS = 3000  # for a frame; at 6 Hz over USB 2 the first one takes half a second


@dataclass(frozen=True)
class DepthFilters:
    """librealsense's spatial filter; its settings have the ranges that the library documents.

    spatial: whether it is on. magnitude: passes, 1 to 5. alpha: 0.25 to 1, 1 is no filter. delta: 1 to 50, steps of
    1/32 pixel of disparity, beyond which two neighbours are two surfaces.
    """

    spatial: bool = True
    magnitude: int = 2
    alpha: float = 0.5
    delta: int = 20


def realsense() -> Any:
    """The module pyrealsense2. Raises MissingExtra that names what to install."""
    try:
        return library("pyrealsense2", "realsense")
    except MissingExtra as error:
        if "libusb" not in str(error.__cause__):
            raise
        raise MissingExtra(_SYSTEM) from error


class RealSenseCamera:
    """A depth camera; fulfils `DepthCamera`.

    Args:
        device: of librealsense, a software device included; None: the first that is plugged in.
        resolution: of the depth stream, "848x480", …
        frames: that `grab` takes and averages.
        filters: see the module.

    Raises ConnectionLost where no camera is there, RobotError for a resolution that it does not have.
    """

    def __init__(
        self,
        device: Any = None,
        resolution: str = "848x480",
        frames: int = 8,
        filters: DepthFilters | None = None,
    ) -> None:
        if frames < 1:
            raise RobotError(f"frames={frames}: at least 1")
        rs = realsense()
        self.frames = frames
        self._device = first_device() if device is None else device
        self._sensor = self._device.first_depth_sensor()
        self.depth_scale = float(self._sensor.get_depth_scale())  # m a unit
        profile = _profile(self._sensor, rs.stream.depth, rs.format.z16, resolution)
        self.intrinsics = intrinsics_of_profile(profile)
        self._filters = _chain(DepthFilters() if filters is None else filters)
        self._queue = rs.frame_queue(frames + 1)
        self._sensor.open(profile)
        self._sensor.start(self._queue)
        self._open = True

    def grab(self) -> DepthImage:
        """The mean of the next frames. Raises ConnectionLost where none comes."""
        while self._queue.poll_for_frame():
            pass  # taken before the call, perhaps while the arm moved
        depths, time = [], 0.0
        for _ in range(self.frames):
            try:
                frame = self._queue.wait_for_frame(_WAIT_MS)
            except RuntimeError as error:
                raise ConnectionLost(
                    f"no frame from the camera within {_WAIT_MS / 1e3:g} s ({error}): is its cable in a USB 3 socket?"
                ) from error
            time = frame.get_timestamp() / 1e3
            for each in self._filters:
                frame = each.process(frame)
            depths.append(np.asanyarray(frame.get_data()) * np.float32(self.depth_scale))
        return DepthImage(mean_depth(np.array(depths)), self.intrinsics, time)

    def close(self) -> None:
        if self._open:
            self._open = False
            self._sensor.stop()
            self._sensor.close()

    def __enter__(self) -> RealSenseCamera:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def first_device() -> Any:
    """Raises ConnectionLost where no camera is plugged in."""
    devices = realsense().context().query_devices()
    if not len(devices):
        raise ConnectionLost(
            "no RealSense camera is plugged in, or this user may not read it: see its cable, and librealsense's udev "
            "rules"
        )
    return devices[0]


def infrared_image(device: Any = None, resolution: str = "848x480") -> tuple[np.ndarray, CameraIntrinsics]:
    """(H, W) uint8 of the left imager, whose frame is the depth's, without the projector's dots: for `pecgrasp
    calibrate`. Raises as `RealSenseCamera` does.
    """
    rs = realsense()
    sensor = (first_device() if device is None else device).first_depth_sensor()
    profile = _profile(sensor, rs.stream.infrared, rs.format.y8, resolution)
    if sensor.supports(rs.option.emitter_enabled) and not sensor.is_option_read_only(rs.option.emitter_enabled):
        sensor.set_option(rs.option.emitter_enabled, 0)
    queue = rs.frame_queue(2)
    sensor.open(profile)
    sensor.start(queue)
    try:
        for _ in range(_SETTLING):  # the exposure settles, and the projector goes out
            frame = queue.wait_for_frame(_WAIT_MS)
        return np.array(frame.get_data()), intrinsics_of_profile(profile)
    except RuntimeError as error:
        raise ConnectionLost(f"no infrared image from the camera: {error}") from error
    finally:
        sensor.stop()
        sensor.close()


_SETTLING = 10  # frames


def intrinsics_of_profile(profile: Any) -> CameraIntrinsics:
    """Of a stream; librealsense counts from the first pixel's centre. Raises RobotError where there is distortion."""
    given = profile.as_video_stream_profile().get_intrinsics()
    if np.any(np.abs(given.coeffs) > 1e-6):
        raise RobotError(
            f"the stream has distortion {list(given.coeffs)}: only rectified ones are read, as a D400's depth is"
        )
    return CameraIntrinsics(given.width, given.height, given.fx, given.fy, given.ppx + 0.5, given.ppy + 0.5)


def _profile(sensor: Any, stream: Any, form: Any, resolution: str) -> Any:
    """The fastest of a sensor's streams of one kind and size, the left one of two."""
    found: list[tuple[int, int, int, Any]] = []
    sizes: set[str] = set()
    for profile in sensor.get_stream_profiles():
        if profile.stream_type() == stream and profile.format() == form and profile.is_video_stream_profile():
            video = profile.as_video_stream_profile()
            size = f"{video.width()}x{video.height()}"
            sizes.add(size)
            if size == resolution:
                found.append((profile.stream_index(), -profile.fps(), len(found), profile))
    if not found:
        raise RobotError(
            f"resolution={resolution}: the camera's {stream.name} has {', '.join(sorted(sizes)) or 'none'}"
        )
    return min(found)[3]


def _chain(filters: DepthFilters) -> list[Any]:
    """What each frame passes through: to disparity, smoothed there, and back."""
    if not filters.spatial:
        return []
    rs = realsense()
    spatial = rs.spatial_filter()
    spatial.set_option(rs.option.filter_magnitude, filters.magnitude)
    spatial.set_option(rs.option.filter_smooth_alpha, filters.alpha)
    spatial.set_option(rs.option.filter_smooth_delta, filters.delta)
    spatial.set_option(rs.option.holes_fill, 0)
    return [rs.disparity_transform(True), spatial, rs.disparity_transform(False)]
