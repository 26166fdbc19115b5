"""Labelled clouds of several classes, parts of them, and the dissertation's defects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pec.errors import DatasetError

__all__ = ["UNKNOWN", "CloudDataset", "remove_around_random_point"]

UNKNOWN = "unknown"
"""The reserved class of strangers: things that are none of the others. It is always the last one."""

_INCH = 0.0254  # m; ModelNet's files name no unit, most of its furniture is of life size if one of theirs is an inch


@dataclass(frozen=True)
class CloudDataset:
    """Clouds of several classes.

    A class has instances (one mesh or one draw of a procedural shape), an instance has samples (one cloud each).
    """

    classes: list[str]
    clouds: list[np.ndarray]
    """(N, 3) float32 each, metres; read-only views of the data set's files where it was loaded from such."""
    labels: np.ndarray
    """(n,) int64, index into `classes`."""
    instances: np.ndarray
    """(n,) int64, equal for samples of one instance, different between classes."""
    fingerprint: str
    """Differs where the data differ: the hashes of what was read."""
    test: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Splits that came with the data, by name ("sample", "instance", "official"): (n,) bool, true for test."""
    mesh_scales: np.ndarray | None = None
    """(n,) what clouds that were scaled to one size are divided by to have the size of their mesh, in its unit."""
    stored: np.ndarray | None = None
    """(n,) int64, places of the clouds among all that the data set's files hold."""
    originals: np.ndarray | None = None
    """(n,) int64, equal for an instance and its deformed copies; None: there are no copies."""

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def things(self) -> np.ndarray:
        """(n,) int64: what a split by instance keeps on one side, an instance with its deformed copies."""
        return self.instances if self.originals is None else self.originals

    @property
    def known_classes(self) -> list[str]:
        """The classes without UNKNOWN."""
        return [name for name in self.classes if name != UNKNOWN]

    @property
    def has_strangers(self) -> bool:
        """Whether the last class is UNKNOWN."""
        return UNKNOWN in self.classes

    @property
    def is_known(self) -> np.ndarray:
        """(n,) bool: which clouds are no strangers'."""
        return self.labels < len(self.known_classes)

    @property
    def offsets(self) -> np.ndarray:
        """(n + 1,) int64: 0 and the sums of the clouds' lengths."""
        return np.cumsum([0, *map(len, self.clouds)], dtype=np.int64)

    @property
    def official_test(self) -> np.ndarray | None:
        """(n,) bool where the data come with a split of their own."""
        return self.test.get("official")

    def cloud(self, index: int) -> np.ndarray:
        """The (N, 3) float32 points of sample `index`."""
        return self.clouds[index]

    def subset(self, indices: np.ndarray) -> CloudDataset:
        """The samples `indices`, with all classes."""
        return replace(
            self,
            clouds=[self.clouds[i] for i in indices],
            labels=self.labels[indices],
            instances=self.instances[indices],
            test={name: mask[indices] for name, mask in self.test.items()},
            mesh_scales=None if self.mesh_scales is None else self.mesh_scales[indices],
            stored=None if self.stored is None else self.stored[indices],
            originals=None if self.originals is None else self.originals[indices],
        )

    def with_strangers_last(self) -> CloudDataset:
        """The same clouds, UNKNOWN the last class wherever it stood."""
        if UNKNOWN not in self.classes[:-1]:
            return self
        classes = [*self.known_classes, UNKNOWN]
        new_label = np.array([classes.index(name) for name in self.classes])
        return replace(self, classes=classes, labels=new_label[self.labels])

    def in_mesh_size(self) -> CloudDataset:
        """Clouds in the size of their meshes, a unit of theirs taken for an inch; others are metric and stay.

        Raises DatasetError where nothing says what that size was.
        """
        if self.mesh_scales is None:
            raise DatasetError("dataset.size=mesh: these clouds come without the sizes of their meshes")
        metric = np.isclose(self.mesh_scales, 1, atol=1e-4)
        factors = np.where(metric, 1, _INCH / self.mesh_scales).astype(np.float32)
        sized = [cloud * factor for cloud, factor in zip(self.clouds, factors, strict=True)]
        return replace(self, clouds=sized, fingerprint=f"{self.fingerprint} in mesh size")


def remove_around_random_point(points: np.ndarray, max_fraction: float, rng: np.random.Generator) -> np.ndarray:
    """The published defect: `points` (N, 3) without the m nearest of a random point of theirs, m uniform in
    [0, max_fraction · N]; the others keep their order."""
    m = int(rng.uniform(0, max_fraction) * len(points))
    if m == 0:
        return points
    distance = np.square(points - points[rng.integers(len(points))]).sum(axis=1)
    keep = np.ones(len(points), bool)
    keep[np.argpartition(distance, m - 1)[:m]] = False
    return points[keep]
