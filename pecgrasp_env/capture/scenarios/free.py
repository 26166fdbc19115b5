"""The `free` scenario, the published protocol: one object floats alone before the camera, in any pose.

The dissertation draws orientations "over [−π, π]" and positions over [−2, 2] m, and keeps what the camera sees. Here
the orientation is uniform on the rotations (three uniform Euler angles would crowd the poles) and the position of the
object's origin is uniform in the part of the viewing frustum between the camera's minimum depth and `max_depth`, which
is what a uniform draw over the cube leaves once the camera has cut it. A draw is rejected, with its reason counted,
where the object is not wholly in view, is nearer than the minimum depth, or gives fewer than `min_points` points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from pec.data.shards import CloudSample
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.rendering.depth_renderer import DepthRenderer, Renderer, Shot
from pecgrasp_env.capture.scenarios.base import Captured, Subject, measure, random_rotation, sample_seed
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

    def __init__(self, config: CaptureConfig, open_renderer: Callable[[float], Renderer] = DepthRenderer) -> None:
        self._config = config
        self._renderer = open_renderer(config.max_depth)

    def capture(self, subjects: Sequence[Subject], first: int, count: int) -> Captured[CloudSample]:
        captured = Captured[CloudSample]()
        for subject in subjects:
            model = subject.model
            draws = [
                _Draws(sample_seed(self._config.seed, model.class_name, model.instance, number))
                for number in range(first, first + count)
            ]
            try:
                self._renderer.show([model])
                for start in range(0, count, self._renderer.at_once):
                    self._settle_on_poses(draws[start : start + self._renderer.at_once])
            except CaptureError as error:
                captured.given_up[subject.name] = str(error)
                continue
            for each in draws:
                pose = each.shot.T_camera_object
                sample = CloudSample(
                    each.points, subject.class_index, subject.instance_index, pose, each.seed, each.number
                )
                captured.samples.append(sample)
                captured.rejected += each.rejected
        return captured

    def _settle_on_poses(self, draws: Sequence[_Draws]) -> None:
        """Draw poses of the object that is shown, for all side by side, until each has given a cloud."""
        waiting = list(draws)
        while waiting:
            for each in waiting:
                self._aim(each)
            frames = self._renderer.render_all([each.shot for each in waiting])
            for each, frame in zip(waiting, frames, strict=True):
                depth = measure(self._config, frame.depth, frame.intrinsics, each.rng)
                each.points = deproject_mask(depth, frame.depth > 0, frame.intrinsics)
            waiting = [each for each in waiting if len(each.points) < self._config.min_points]
            for each in waiting:
                each.rejected["too few points"] += 1

    def _aim(self, draws: _Draws) -> None:
        """Sets the next shot that is worth taking. Raises CaptureError after too many draws."""
        cameras = self._config.intrinsics
        while draws.rejected.total() < _MOST_DRAWS:
            # With one camera there is nothing to draw: the other draws are those of a set with that camera alone.
            draws.number = int(draws.rng.integers(len(cameras))) if len(cameras) > 1 else 0
            camera = cameras[draws.number]
            pose = random_pose(camera, self._config.max_depth, draws.rng)
            extent = self._renderer.extent(0, pose, camera)
            if extent.nearest < camera.min_depth:
                draws.rejected["too near"] += 1
            elif not extent.within(camera):
                draws.rejected["out of view"] += 1
            elif np.prod(extent.high - extent.low) < self._config.min_points:
                draws.rejected["too few points"] += 1
            else:
                draws.shot = Shot(0, pose, camera, extent)
                return
        reasons = ", ".join(f"{reason}: {count}" for reason, count in draws.rejected.most_common())
        raise CaptureError(
            f"none of {_MOST_DRAWS} poses gave a cloud ({reasons}); a smaller min_points, a higher resolution or a "
            "smaller distance helps small objects"
        )


class _Draws:
    """The draws for one sample, up to the first that gives a cloud."""

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.rng = np.random.default_rng(seed)
        self.rejected: Counter[str] = Counter()
        self.number = 0  # of the camera
        self.shot: Shot
        self.points: np.ndarray
