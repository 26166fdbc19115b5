"""The objects seen on the table: what each view says of their class, and how the views of one object are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

OTHER = "something else"  # what a classifier that names one class leaves to all others
_SAME_OBJECT_M = 0.04  # centroids of one object in two views lie no further apart, those of two objects do


@dataclass
class SeenObject:
    """An object on the table, in the base frame, m.

    points: (M, 3). evidence: for each view the probability of each class. viewpoints: (V, 3) where the camera stood.
    unseen: (U, 3) far ends of lines of sight from the last of them on which nothing was measured.
    """

    points: np.ndarray
    touches_border: bool
    evidence: list[dict[str, float]] = field(default_factory=list)
    viewpoints: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    unseen: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))

    @property
    def centroid(self) -> np.ndarray:
        return self.points.mean(axis=0)

    def probabilities(self) -> dict[str, float]:
        """The views' probabilities, multiplied and normalised: each view is one more independent look."""
        names = sorted({name for view in self.evidence for name in view})
        logs = np.array([sum(np.log(max(view.get(name, 0.0), 1e-3)) for view in self.evidence) for name in names])
        weights = np.exp(logs - logs.max())
        return dict(zip(names, (weights / weights.sum()).tolist(), strict=True))


def merge(known: list[SeenObject], seen: list[SeenObject]) -> list[SeenObject]:
    """Objects of a new view joined with those already known: the same place is the same object; its points add up."""
    result = list(known)
    for new in seen:
        near = [old for old in known if np.linalg.norm((old.centroid - new.centroid)[:2]) < _SAME_OBJECT_M]
        if not near:
            result.append(new)
            continue
        old = min(near, key=lambda candidate: float(np.linalg.norm((candidate.centroid - new.centroid)[:2])))
        old.points = np.concatenate([old.points, new.points])
        old.touches_border = old.touches_border and new.touches_border
        old.evidence += new.evidence
        old.viewpoints, old.unseen = np.concatenate([old.viewpoints, new.viewpoints]), new.unseen
    return result


def class_probabilities(classifier: Any, clouds: Sequence[np.ndarray]) -> list[dict[str, float]]:
    """What a classifier says of clouds (M, 3), camera frame: class → probability; nothing of those with few points.

    ``classifier`` is a `pec.Classifier`, which takes all of them at once, or any callable cloud → (label, confidence).
    """
    least = getattr(classifier, "n_points", 1)
    known = [k for k, cloud in enumerate(clouds) if len(cloud) >= least]
    result: list[dict[str, float]] = [{} for _ in clouds]
    if known and hasattr(classifier, "predict"):
        answers = classifier.predict([clouds[k] for k in known])
        for k, answer in zip(known, answers, strict=True):
            result[k] = {name: float(p) for name, p in answer.probabilities.items()}
    else:
        for k in known:
            label, confidence = classifier(clouds[k])
            result[k] = {label: float(confidence), OTHER: 1.0 - float(confidence)}
    return result
