"""One sample: its seed, and drawing until a pose gives a cloud."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Protocol

import numpy as np

from pec.shards import CloudSample
from pecgrasp_env.capture.config import CaptureError

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["Scenario", "draw_sample", "random_rotation", "rotation_matrix", "sample_seed"]

_MOST_DRAWS = 2000
"""Draws for one sample before the object is given up: an object that fits is accepted once in a few draws."""


class Scenario(Protocol):
    """A way to bring an object before the camera."""

    def show(self, model: ObjectModel) -> None:
        """Make `model` the object that is captured. Raises CaptureError where it cannot fit into the view."""

    def attempt(self, rng: np.random.Generator) -> tuple[np.ndarray | None, np.ndarray, str]:
        """Draw a pose and take a frame: the cloud (N, 3) in the camera frame, m, or None; T_camera_object; why None."""


def sample_seed(seed: int, class_name: str, instance: str, sample: int) -> int:
    """The seed of one sample, 63 bits. It depends on names only, so other classes, workers or orders change nothing."""
    words = [seed, sample, *class_name.encode(), 0, *instance.encode()]
    return int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0] >> np.uint64(1))


def draw_sample(
    scenario: Scenario, class_index: int, instance_index: int, seed: int, rejected: Counter[str]
) -> CloudSample:
    """One labelled cloud of the object that is shown; `seed` decides all of it, `rejected` counts the draws not kept.

    Raises CaptureError where no draw gives a cloud.
    """
    rng = np.random.default_rng(seed)
    tried: Counter[str] = Counter()
    for _ in range(_MOST_DRAWS):
        points, pose, reason = scenario.attempt(rng)
        if points is not None:
            rejected.update(tried)
            return CloudSample(points, class_index, instance_index, pose.astype(np.float32), seed)
        tried[reason] += 1
    reasons = ", ".join(f"{reason}: {count}" for reason, count in tried.most_common())
    raise CaptureError(
        f"none of {_MOST_DRAWS} poses gave a cloud ({reasons}); a smaller min_points, a higher resolution or a smaller "
        "distance helps small objects"
    )


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """(3, 3), uniform on SO(3): four normal values are a quaternion of uniform direction."""
    return rotation_matrix(rng.standard_normal(4))


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """(3, 3) of a quaternion w, x, y, z of any length."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
