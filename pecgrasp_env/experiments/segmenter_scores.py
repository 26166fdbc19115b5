"""How much of labelled scenes a segmenter finds: objects by their overlap with what it cut out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from grasping.segmentation.scene import Scene

IntArray = NDArray[np.int64]

FIRST_OBJECT = 2  # label; 1 is the table, 0 all else
FEWEST = 100  # measured pixels of an object that counts
FOUND = (0.5, 0.75)  # of the union of an object and a segment


@dataclass(frozen=True)
class FrameScore:
    """overlap: (K,) each object's best intersection over union with a segment; visible: (K,) the share that others
    leave of it to be seen; confidence: (S,) of the segments; right: (S,) their best overlap with an object.
    """

    overlap: NDArray[np.float64]
    visible: NDArray[np.float64]
    confidence: NDArray[np.float64]
    right: NDArray[np.float64]


def score(scene: Scene, labels: NDArray, measured: NDArray[np.bool_], visible: NDArray) -> FrameScore:
    """labels: (H, W), from `FIRST_OBJECT` up objects, whose visible shares are visible (M,). measured: (H, W)."""
    segments = np.zeros(labels.size, dtype=np.int64)
    for number, index in enumerate(scene.indices, start=1):
        segments[index] = number
    own = np.where(measured, labels, 0).ravel().astype(np.int64)
    own[own < FIRST_OBJECT] = 0
    count = len(scene.indices) + 1
    most = max(int(own.max()) + 1, FIRST_OBJECT + 1)
    both = np.bincount(segments * most + own, minlength=count * most).reshape(count, most).astype(np.float64)
    union = both.sum(axis=1, keepdims=True) + both.sum(axis=0, keepdims=True) - both
    overlap = (both / np.maximum(union, 1))[1:, FIRST_OBJECT:]
    large = np.flatnonzero(both.sum(axis=0)[FIRST_OBJECT:] >= FEWEST)
    shares = np.ones(most - FIRST_OBJECT)
    shares[: len(visible)] = visible[: len(shares)]
    return FrameScore(
        overlap=overlap[:, large].max(axis=0, initial=0.0),
        visible=shares[large],
        confidence=np.asarray(scene.confidence, dtype=np.float64),
        right=overlap.max(axis=1, initial=0.0),
    )


@dataclass
class Tally:
    """The scores of some frames together."""

    scores: list[FrameScore] = field(default_factory=list)

    def found(self, least: float, least_visible: float = 0.0) -> tuple[int, int]:
        """Objects found at this overlap, and objects, of those that are as visible."""
        overlap = self._all("overlap")[self._all("visible") >= least_visible]
        return int(np.count_nonzero(overlap > least)), len(overlap)

    def right(self, least: float) -> tuple[int, int]:
        """Segments that are an object at this overlap, and segments."""
        right = self._all("right")
        return int(np.count_nonzero(right > least)), len(right)

    def calibration(self, steps: int = 5) -> list[tuple[float, float, int]]:
        """For steps of the confidence: its mean, the share of segments that are whole objects, and their number."""
        sure, right = self._all("confidence"), self._all("right") > FOUND[1]
        rows = []
        for step in range(steps):
            inside = (sure >= step / steps) & ((sure < (step + 1) / steps) | (step == steps - 1))
            if inside.any():
                rows.append((float(sure[inside].mean()), float(right[inside].mean()), int(np.count_nonzero(inside))))
        return rows

    def _all(self, name: str) -> NDArray[np.float64]:
        return np.concatenate([[], *(getattr(each, name) for each in self.scores)])
