"""The `free` scenario, the published protocol: one object floats alone before the camera, in any pose.

The dissertation draws orientations "over [−π, π]" and positions over [−2, 2] m, and keeps what the camera sees. Here
the orientation is uniform on the rotations (three uniform Euler angles would crowd the poles) and the position of the
object's origin is uniform in the part of the viewing frustum between the camera's minimum depth and `max_depth`, which
is what a uniform draw over the cube leaves once the camera has cut it. A draw is rejected, with its reason counted,
where the object is not wholly in view, is nearer than the minimum depth, or gives fewer than `min_points` points.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from pec.shards import CloudSample
from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.studio import DepthStudio
from pecgrasp_env.sensor import CameraIntrinsics, apply_d435, apply_ideal, deproject_mask

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["FreeScenario", "random_pose", "sample_seed"]

_MOST_DRAWS = 2000
"""Draws for one sample before the object is given up: an object that fits is accepted once in a few draws."""


def sample_seed(seed: int, class_name: str, instance: str, sample: int) -> int:
    """The seed of one sample, 63 bits. It depends on names only, so other classes, workers or orders change nothing."""
    words = [seed, sample, *class_name.encode(), 0, *instance.encode()]
    return int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0] >> np.uint64(1))


def random_pose(intrinsics: CameraIntrinsics, max_depth: float, rng: np.random.Generator) -> np.ndarray:
    """T_camera_object (4, 4): rotation uniform on SO(3), origin uniform in the frustum up to max_depth (m)."""
    near = intrinsics.min_depth
    z = np.cbrt(rng.uniform(near**3, max_depth**3))  # the frustum's cross-section grows as z²
    column, row = rng.uniform(0, intrinsics.width), rng.uniform(0, intrinsics.height)
    pose = np.eye(4)
    pose[:3, 3] = (column - intrinsics.cx) / intrinsics.fx * z, (row - intrinsics.cy) / intrinsics.fy * z, z
    pose[:3, :3] = _rotation(rng.standard_normal(4))
    return pose


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    """(3, 3) of a quaternion w, x, y, z of any length; four normal values give a uniform rotation (Shoemake)."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class FreeScenario:
    """Captures labelled clouds of one object after another."""

    def __init__(self, config: CaptureConfig) -> None:
        self._config = config
        self._intrinsics = config.intrinsics
        self._studio = DepthStudio(config.intrinsics)
        self._name = ""
        self._outline = np.zeros((0, 3))

    def show(self, model: ObjectModel) -> None:
        """Make `model` the object that is captured. Raises CaptureError where it cannot fit into the view."""
        vertices = np.concatenate([part.vertices for part in model.parts]).astype(np.float64)
        size = float(np.ptp(vertices, axis=0).max())
        if not 0.005 <= size <= self._config.max_depth:
            raise CaptureError(
                f"{model.instance} is {size:.4g} m long; from 0.005 m up to max_depth {self._config.max_depth} m is "
                "possible. Is it in other units? objects.scale=0.001 turns millimetres into metres"
            )
        # The hull's corners project onto the corners of the silhouette: they decide what is in view.
        self._outline = vertices[ConvexHull(vertices).vertices]
        self._name = model.instance
        self._studio.show(model)

    def capture(self, class_index: int, instance_index: int, seed: int, rejected: Counter[str]) -> CloudSample:
        """One labelled cloud; `seed` decides everything about it, `rejected` counts the draws that were not kept.

        Raises CaptureError where no draw gives a cloud.
        """
        rng = np.random.default_rng(seed)
        tried: Counter[str] = Counter()
        for _ in range(_MOST_DRAWS):
            pose = random_pose(self._intrinsics, self._config.max_depth, rng)
            points, reason = self._try(pose, rng)
            if points is not None:
                rejected.update(tried)
                return CloudSample(points, class_index, instance_index, pose.astype(np.float32), seed)
            tried[reason] += 1
        reasons = ", ".join(f"{reason}: {count}" for reason, count in tried.most_common())
        raise CaptureError(
            f"{self._name}: none of {_MOST_DRAWS} poses gave a cloud of {self._config.min_points} points ({reasons}); "
            "a smaller min_points, a higher resolution or a smaller max_depth helps small objects"
        )

    def _try(self, pose: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray | None, str]:
        camera = self._intrinsics
        corners = self._outline @ pose[:3, :3].T + pose[:3, 3]
        if corners[:, 2].min() < camera.min_depth:
            return None, "too near"
        pixels = corners[:, :2] / corners[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        if low.min() < 0 or high[0] > camera.width or high[1] > camera.height:
            return None, "out of view"
        if np.prod(high - low) < self._config.min_points:
            return None, "too few points"  # not even its bounding rectangle has that many pixels
        exact, window = self._studio.photograph(pose, low, high)
        if self._config.sensor == "d435":
            depth = apply_d435(exact, window, rng, self._config.noise)
        else:
            depth = apply_ideal(exact, window)
        points = deproject_mask(depth, exact > 0, window)
        if len(points) < self._config.min_points:
            return None, "too few points"
        return points, ""
