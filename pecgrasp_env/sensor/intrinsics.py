"""The D435 as a pinhole camera: intrinsics, minimum depth and deprojection.

Frames and units: depth images are (H, W) float32 metres along the optical axis, 0 where nothing was measured; clouds
lie in the camera frame (OpenCV: x right, y down, z forward), which is the left imager's, as on the device. A pixel in
row r and column c covers [c, c + 1) x [r, r + 1) of the image plane and its ray passes through its centre
(c + 0.5, r + 0.5); `cx`, `cy` are measured from the image's corner, so a central principal point is (W / 2, H / 2).
This is SAPIEN's and ManiSkill's convention too; a `CameraInfo` that counts from the first pixel's centre has 0.5 less.

How the intrinsics are made: the focal length follows from the data sheet's horizontal field of view of a mode, 87
degrees in the 16:9 modes and 75 degrees in 640x480 (the 4:3 mode uses less of the imager's width); pixels are square
and the principal point is central. The vertical field of view is then 56 to 60 degrees; the data sheet says about 58.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

__all__ = [
    "BASELINE",
    "D435",
    "FAR",
    "LARGEST_FOCAL_LENGTH",
    "NEAR",
    "CameraIntrinsics",
    "SensorError",
    "deproject",
    "deproject_mask",
    "intrinsics_of",
    "min_depth",
]

BASELINE = 0.050
"""Distance between the two infrared imagers, metres (D435 data sheet)."""

NEAR, FAR = 0.05, 10.0
"""Clipping planes, metres: nearer than any minimum depth of the D435, and the farthest that it measures."""
LARGEST_FOCAL_LENGTH = 20_000.0
"""Pixels; what is larger is no camera."""


class SensorError(ValueError):
    """A resolution, a mode or a noise parameter that the sensor does not have."""


@dataclass(frozen=True)
class CameraIntrinsics:
    """A pinhole camera without distortion; see the module's docstring for the pixel convention."""

    width: int
    height: int
    fx: float
    """Focal length in pixels."""
    fy: float
    cx: float
    """Principal point in pixels from the image's left border."""
    cy: float
    min_depth: float = 0.0
    """Metres; nearer surfaces give holes."""
    first_column: int = 0
    """Columns of the sensor that lie left of this image: not zero for a `window` of it."""

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) float64 calibration matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def window(self, column: int, row: int, width: int, height: int) -> CameraIntrinsics:
        """The same camera read out over a rectangle only: its pixels look along the same rays as the full image's."""
        return replace(
            self,
            width=width,
            height=height,
            cx=self.cx - column,
            cy=self.cy - row,
            first_column=self.first_column + column,
        )


def _from_field_of_view(width: int, height: int, horizontal_degrees: float, nearest: float) -> CameraIntrinsics:
    focal = width / 2 / np.tan(np.radians(horizontal_degrees) / 2)
    return CameraIntrinsics(width, height, float(focal), float(focal), width / 2, height / 2, nearest)


D435: dict[str, CameraIntrinsics] = {
    "424x240": _from_field_of_view(424, 240, 87.0, 0.105),
    "640x480": _from_field_of_view(640, 480, 75.0, 0.175),
    "848x480": _from_field_of_view(848, 480, 87.0, 0.195),
    "1280x720": _from_field_of_view(1280, 720, 87.0, 0.280),
}
"""Depth modes of the D435: fields of view and minimum depths of the data sheet."""


def intrinsics_of(resolution: str) -> CameraIntrinsics:
    """Intrinsics of a depth mode such as "424x240". Raises SensorError where the D435 has no such mode."""
    if resolution not in D435:
        raise SensorError(f"resolution {resolution!r} is not a depth mode of the D435; choose one of {', '.join(D435)}")
    return D435[resolution]


def min_depth(resolution: str) -> float:
    """Smallest depth, metres, that the D435 measures in a depth mode. Raises SensorError as `intrinsics_of` does."""
    return intrinsics_of(resolution).min_depth


def deproject(depth: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
    """Depth image (H, W), metres → (H, W, 3) float32 points in the camera frame; NaN where there is no depth."""
    height, width = depth.shape
    z = np.where(depth > 0, depth, np.nan).astype(np.float32)
    cloud = np.empty((height, width, 3), np.float32)
    cloud[..., 0] = z * (
        (np.arange(width, dtype=np.float32) + np.float32(0.5 - intrinsics.cx)) / np.float32(intrinsics.fx)
    )
    rows = (np.arange(height, dtype=np.float32) + np.float32(0.5 - intrinsics.cy)) / np.float32(intrinsics.fy)
    cloud[..., 1] = z * rows[:, None]
    cloud[..., 2] = z
    return cloud


def deproject_mask(depth: np.ndarray, mask: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
    """Only the pixels of `mask` (H, W) bool that have depth, row by row → (N, 3) float32 points in the camera frame."""
    rows, columns = np.nonzero(mask & (depth > 0))
    z = depth[rows, columns].astype(np.float32)
    x = (columns.astype(np.float32) + np.float32(0.5 - intrinsics.cx)) / np.float32(intrinsics.fx)
    y = (rows.astype(np.float32) + np.float32(0.5 - intrinsics.cy)) / np.float32(intrinsics.fy)
    return np.stack([x * z, y * z, z], axis=1)
