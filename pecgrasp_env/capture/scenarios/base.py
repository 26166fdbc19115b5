"""What a scenario takes and gives, and the seeds that decide its draws."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import numpy as np

from pecgrasp_env.capture.config import CaptureConfig
from pecgrasp_env.sensor import CameraIntrinsics, D435Noise, apply_d435, apply_ideal

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

Sample = TypeVar("Sample")

__all__ = ["Captured", "Scenario", "Subject", "measure", "random_rotation", "rotation_matrix", "sample_seed"]


@dataclass(frozen=True)
class Subject:
    """An object to be captured, and its indices in the manifest."""

    model: ObjectModel
    class_index: int
    instance_index: int

    @property
    def name(self) -> str:
        """Class and instance: instances of two classes may have one name."""
        return f"{self.model.class_name}/{self.model.instance}"


@dataclass
class Captured(Generic[Sample]):
    """What a scenario made of its subjects.

    samples: in the order of the subjects, each subject's in the order of their making. rejected: draws that gave no
    sample, by reason. given_up: why a subject could not be captured, by its name; it has no samples.
    """

    samples: list[Sample] = field(default_factory=list)
    rejected: Counter[str] = field(default_factory=Counter)
    given_up: dict[str, str] = field(default_factory=dict)


class Scenario(Protocol[Sample]):
    """A way to bring objects before the camera."""

    def capture(self, subjects: Sequence[Subject], first: int, count: int) -> Captured[Sample]:
        """Samples `first` to `first + count` of each subject; the same whatever was captured before."""


def sample_seed(seed: int, class_name: str, instance: str, sample: int) -> int:
    """The seed of one sample, 63 bits. It depends on names only, so other classes, workers or orders change nothing."""
    words = [seed, sample, *class_name.encode(), 0, *instance.encode()]
    return int(np.random.SeedSequence(words).generate_state(1, np.uint64)[0] >> np.uint64(1))


def measure(
    config: CaptureConfig, depth: np.ndarray, intrinsics: CameraIntrinsics, rng: np.random.Generator
) -> np.ndarray:
    """What the configured D435 makes of an exact depth image (H, W), m."""
    if config.sensor == "d435":
        assert isinstance(config.noise, D435Noise)
        return apply_d435(depth, intrinsics, rng, config.noise)
    return apply_ideal(depth, intrinsics)


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
