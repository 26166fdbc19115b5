"""Depth frames from a folder as a camera: what was seen once is seen again, in the order of the files' names.

A frame is a .npz as `pecgrasp plan` reads it: `depth` (H, W), `K` (3, 3), which counts from the first pixel's centre,
and `time`, s, where it is known; integers are millimetres or what `depth_scale` says.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from grasping.cloud_files.depth_frame import checked_intrinsics
from grasping.errors import DAMAGED_NPZ, CloudError
from pecgrasp_env.real.errors import ConnectionLost, RobotError
from pecgrasp_env.real.interfaces import DepthImage
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics


class RecordedCamera:
    """Fulfils `DepthCamera`. Raises RobotError for a folder without frames."""

    def __init__(self, folder: str | Path) -> None:
        self.files = sorted(Path(folder).glob("*.npz"))
        if not self.files:
            raise RobotError(f"{folder}: no frames *.npz in it")
        self._next = 0

    def grab(self) -> DepthImage:
        """The next frame. Raises ConnectionLost after the last one, RobotError for a file that holds none."""
        if self._next == len(self.files):
            raise ConnectionLost(f"{self.files[-1]} was the last of {len(self.files)} recorded frames")
        self._next += 1
        return read_depth_image(self.files[self._next - 1])

    def close(self) -> None:
        self._next = len(self.files)


def read_depth_image(path: Path) -> DepthImage:
    """Raises RobotError that names the file and what is wrong in it."""
    try:
        with np.load(path) as stored:
            depth, K = stored["depth"], stored["K"]
            time = float(stored["time"]) if "time" in stored else 0.0
            scale = (
                float(stored["depth_scale"]) if "depth_scale" in stored else 1.0 if depth.dtype.kind == "f" else 1e-3
            )
    except DAMAGED_NPZ as error:
        raise RobotError(f"{path}: {error}: a frame has depth (H, W) and K (3, 3)") from error
    if depth.ndim != 2 or depth.dtype.kind not in "fiu":
        raise RobotError(f"{path}: depth is {depth.dtype} of shape {depth.shape}: numbers (H, W) are wanted")
    try:
        K = checked_intrinsics(K, depth.shape)
    except CloudError as error:
        raise RobotError(f"{path}: {error}") from error
    metres = np.nan_to_num(depth.astype(np.float32) * np.float32(scale), nan=0.0, posinf=0.0, neginf=0.0)
    return DepthImage(np.maximum(metres, 0), intrinsics_of_stored(K, depth.shape), time)


def write_depth_image(path: Path, image: DepthImage) -> None:
    """What `read_depth_image` reads, in whole tenths of a millimetre: a tenth of what the sensor resolves."""
    units = np.clip(np.rint(np.nan_to_num(image.depth) * 1e4), 0, np.iinfo(np.uint16).max).astype(np.uint16)
    np.savez_compressed(path, depth=units, K=stored_K(image.intrinsics), depth_scale=1e-4, time=image.time)


def stored_K(intrinsics: CameraIntrinsics) -> np.ndarray:
    """(3, 3) that counts from the first pixel's centre, as files have it."""
    return intrinsics.matrix - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]


def intrinsics_of_stored(K: np.ndarray, shape: tuple[int, ...]) -> CameraIntrinsics:
    """The inverse of `stored_K`; shape: (H, W)."""
    return CameraIntrinsics(shape[1], shape[0], K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5)
