"""The `free` scenario, the published protocol: one object floats alone before the camera, in any pose.

The dissertation draws orientations "over [−π, π]" and positions over [−2, 2] m, and keeps what the camera sees. Here
the orientation is uniform on the rotations (three uniform Euler angles would crowd the poles) and the position of the
object's origin is uniform in the part of the viewing frustum between the camera's minimum depth and `max_depth`, which
is what a uniform draw over the cube leaves once the camera has cut it. A draw is rejected, with its reason counted,
where the object is not wholly in view, is nearer than the minimum depth, or gives fewer than `min_points` points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pecgrasp_env.capture.config import CaptureConfig
from pecgrasp_env.capture.samples import random_rotation
from pecgrasp_env.capture.studio import DepthStudio
from pecgrasp_env.sensor import CameraIntrinsics, deproject_mask

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["FreeScenario", "random_pose"]


def random_pose(intrinsics: CameraIntrinsics, max_depth: float, rng: np.random.Generator) -> np.ndarray:
    """T_camera_object (4, 4): rotation uniform on SO(3), origin uniform in the frustum up to max_depth (m)."""
    near = intrinsics.min_depth
    z = np.cbrt(rng.uniform(near**3, max_depth**3))  # the frustum's cross-section grows as z²
    column, row = rng.uniform(0, intrinsics.width), rng.uniform(0, intrinsics.height)
    pose = np.eye(4)
    pose[:3, 3] = (column - intrinsics.cx) / intrinsics.fx * z, (row - intrinsics.cy) / intrinsics.fy * z, z
    pose[:3, :3] = random_rotation(rng)
    return pose


class FreeScenario:
    """One object alone before the camera, in any pose within its view."""

    def __init__(self, config: CaptureConfig) -> None:
        self._config = config
        self._studio = DepthStudio(config)

    def show(self, model: ObjectModel) -> None:
        self._studio.show(model)

    def attempt(self, rng: np.random.Generator) -> tuple[np.ndarray | None, np.ndarray, str]:
        pose = random_pose(self._studio.intrinsics, self._config.max_depth, rng)
        frame, reason = self._studio.photograph(pose)
        if frame is None:
            return None, pose, reason
        depth = self._studio.measure(frame.depth, frame.intrinsics, rng)
        points = deproject_mask(depth, frame.depth > 0, frame.intrinsics)
        if len(points) < self._config.min_points:
            return None, pose, "too few points"
        return points, pose, ""
