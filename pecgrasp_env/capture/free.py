"""The `free` scenario, the published protocol: one object floats alone before the camera, in any pose.

The dissertation draws orientations "over [−π, π]" and positions over [−2, 2] m, and keeps what the camera sees. Here
the orientation is uniform on the rotations (three uniform Euler angles would crowd the poles) and the position of the
object's origin is uniform in the part of the viewing frustum between the camera's minimum depth and `max_depth`, which
is what a uniform draw over the cube leaves once the camera has cut it. A draw is rejected, with its reason counted,
where the object is not wholly in view, is nearer than the minimum depth, or gives fewer than `min_points` points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from pec.shards import CloudSample
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.samples import Captured, Subject, measure, random_rotation, sample_seed
from pecgrasp_env.capture.studio import DepthStudio
from pecgrasp_env.sensor import CameraIntrinsics, deproject_mask

__all__ = ["FreeScenario", "random_pose"]

_MOST_DRAWS = 2000
"""Draws for one sample before the object is given up: an object that fits is accepted once in a few draws."""


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
    """Objects one by one, each alone before the camera, in any pose within its view."""

    def __init__(self, config: CaptureConfig) -> None:
        self._config = config
        self._studio = DepthStudio(config.max_depth)

    def capture(self, subjects: Sequence[Subject], first: int, count: int) -> Captured:
        captured = Captured()
        for subject in subjects:
            model = subject.model
            rejected: Counter[str] = Counter()
            seeds = (
                sample_seed(self._config.seed, model.class_name, model.instance, number)
                for number in range(first, first + count)
            )
            try:
                self._studio.show([model])
                samples = [self._draw(subject, seed, rejected) for seed in seeds]
            except CaptureError as error:
                captured.given_up[subject.name] = str(error)
                continue
            captured.samples += samples
            captured.rejected += rejected
        return captured

    def _draw(self, subject: Subject, seed: int, rejected: Counter[str]) -> CloudSample:
        """One sample of the object that is shown: the first of `seed`'s draws that gives a cloud."""
        rng = np.random.default_rng(seed)
        tried: Counter[str] = Counter()
        for _ in range(_MOST_DRAWS):
            cameras = self._config.intrinsics
            # With one camera there is nothing to draw: the other draws are those of a set with that camera alone.
            number = int(rng.integers(len(cameras))) if len(cameras) > 1 else 0
            pose = random_pose(cameras[number], self._config.max_depth, rng)
            points, reason = self._attempt(pose, cameras[number], rng)
            if points is not None:
                rejected.update(tried)
                return CloudSample(points, subject.class_index, subject.instance_index, pose, seed, number)
            tried[reason] += 1
        reasons = ", ".join(f"{reason}: {count}" for reason, count in tried.most_common())
        raise CaptureError(
            f"none of {_MOST_DRAWS} poses gave a cloud ({reasons}); a smaller min_points, a higher resolution or a "
            "smaller distance helps small objects"
        )

    def _attempt(
        self, pose: np.ndarray, camera: CameraIntrinsics, rng: np.random.Generator
    ) -> tuple[np.ndarray | None, str]:
        extent = self._studio.extent(0, pose, camera)
        if extent.nearest < camera.min_depth:
            return None, "too near"
        if not extent.within(camera):
            return None, "out of view"
        if np.prod(extent.high - extent.low) < self._config.min_points:
            return None, "too few points"
        frame = self._studio.photograph(0, pose, camera, extent)
        depth = measure(self._config, frame.depth, frame.intrinsics, rng)
        points = deproject_mask(depth, frame.depth > 0, frame.intrinsics)
        if len(points) < self._config.min_points:
            return None, "too few points"
        return points, ""
