"""The objects seen on the table: what each view says of their class, and how the views of one object are joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

OTHER = "something else"  # what a classifier that names one class leaves to all others
UNKNOWN = "unknown"  # of none of the classifier's classes
_SAME_OBJECT_M = 0.04  # centroids of one object in two views lie no further apart, those of two apart do
_SAME_PLACE_M = 0.010  # noise, and what of a surface one view saw and the other did not
_OVERLAP = 0.2  # of an object's pixels that may belong to another, as edges do
_COMPARED = 400  # points of an object
_PARTLY, _MOSTLY = 0.3, 0.6  # of an object
_LEAST = 1e-3  # probability that one view, or one witness, leaves to either side


@dataclass
class SeenObject:
    """An object on the table, in the base frame, m.

    points: (M, 3). evidence: for each view the probability of each class. viewpoints: (V, 3) where the camera stood.
    unseen: (U, 3) far ends of lines of sight from the last of them on which nothing was measured. certainty: how sure
    the segmenter is, in [0, 1], that it is one whole object; of several views the surest.
    """

    points: np.ndarray
    touches_border: bool
    evidence: list[dict[str, float]] = field(default_factory=list)
    viewpoints: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    unseen: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    certainty: float = 1.0

    @property
    def centroid(self) -> np.ndarray:
        return self.points.mean(axis=0)

    def probabilities(self) -> dict[str, float]:
        """Of each class, and of UNKNOWN where a view says something of it; sum 1.

        The views' probabilities of the classes are multiplied and normalised: each view is one more independent look.
        Of its being of none of them the views' log-odds are averaged: a stranger that looks like a class from one side
        does so from the next.
        """
        names = sorted({name for view in self.evidence for name in view} - {UNKNOWN})
        known = self.known
        if not names:
            return {UNKNOWN: 1.0 - known}
        logs = np.array([sum(np.log(max(view.get(name, 0.0), 1e-3)) for view in self.evidence) for name in names])
        weights = np.exp(logs - logs.max())
        shares = dict(zip(names, (known * weights / weights.sum()).tolist(), strict=True))
        return shares | ({UNKNOWN: 1.0 - known} if known < 1 else {})

    @property
    def known(self) -> float:
        """The probability that it is of one of the classes; 1 where no view says otherwise."""
        strange = [view[UNKNOWN] for view in self.evidence if UNKNOWN in view]
        return 1.0 - from_log_odds(np.mean(log_odds(strange))) if strange else 1.0

    def is_a(self, name: str) -> float:
        """The probability that it is of a class, by two witnesses: how well it is known, and what share of that the
        class has. Their odds are multiplied: a stranger, or what was cut wrongly, seldom looks clearly like one class.
        """
        return from_log_odds(self._log_odds_of(name))

    def _log_odds_of(self, name: str) -> float:
        known = self.known
        return float(log_odds(known) + log_odds(self.probabilities().get(name, 0.0) / max(known, _LEAST)))

    @property
    def trust(self) -> float:
        """In [0, 1], how likely it is one whole object, and of the class that it looks like: the odds of the
        segmenter's certainty and of the classifier's two answers, as in `is_a`, multiplied. 0 of what is too small for
        the classifier.
        """
        names = {name for view in self.evidence for name in view} - {UNKNOWN}
        if not names:
            return 0.0
        return from_log_odds(log_odds(self.certainty) + max(self._log_odds_of(name) for name in names))


def log_odds(probability: Any) -> Any:
    """Of probabilities, each at least _LEAST and at most as much less than 1."""
    clipped = np.clip(probability, _LEAST, 1.0 - _LEAST)
    return np.log(clipped / (1.0 - clipped))


def from_log_odds(odds: float) -> float:
    """The probability that has these log odds."""
    return float(1.0 / (1.0 + np.exp(-odds)))


def merge(known: list[SeenObject], seen: list[SeenObject]) -> list[SeenObject]:
    """Objects of a new view joined with those already known: the same place is the same object; its points add up.

    Where one view tells apart what is one object in the other, that view is right of which one object can be trusted
    most, and of equals that which tells apart.
    """
    shares = np.array([[_shared(old, new) for new in seen] for old in known]).reshape(len(known), len(seen), 2)
    of_old, of_new = shares[..., 0], shares[..., 1]
    left_out_old, left_out_new = np.zeros(len(known), bool), np.zeros(len(seen), bool)
    for i in range(len(known)):
        pieces = np.flatnonzero(of_new[i] > _MOSTLY)
        if len(pieces) > 1:
            if known[i].trust > max(seen[j].trust for j in pieces):
                left_out_new[pieces] = True
            else:
                left_out_old[i] = True
    for j in range(len(seen)):
        pieces = np.flatnonzero((of_old[:, j] > _MOSTLY) & ~left_out_old)
        if len(pieces) > 1 and not left_out_new[j]:
            if seen[j].trust > max(known[i].trust for i in pieces):
                left_out_old[pieces] = True
            else:
                left_out_new[j] = True
    near = [[is_near(old, new) for new in seen] for old in known]
    # What covers the same place first, then what only has its middle there, as two sides of one object do.
    score = np.maximum(of_old, of_new)
    score = np.where(score > _PARTLY, 1.0 + score, np.array(near, float).reshape(score.shape))
    score[left_out_old] = score[:, left_out_new] = 0.0
    result = [old for old, left_out in zip(known, left_out_old, strict=True) if not left_out]
    joined = left_out_new.copy()
    while score.size and score.max() > 0:
        i, j = divmod(int(score.argmax()), score.shape[1])
        score[i], score[:, j], joined[j] = 0.0, 0.0, True
        old, new = known[i], seen[j]
        old.points = np.concatenate([old.points, new.points])
        old.touches_border = old.touches_border and new.touches_border
        old.evidence += new.evidence
        old.viewpoints, old.unseen = np.concatenate([old.viewpoints, new.viewpoints]), new.unseen
        old.certainty = max(old.certainty, new.certainty)
    return result + [new for new, gone in zip(seen, joined, strict=True) if not gone]


def is_near(one: SeenObject, other: SeenObject) -> bool:
    """Whether the middles of two lie as near to each other as those of one object in two views."""
    return bool(np.linalg.norm((one.centroid - other.centroid)[:2]) < _SAME_OBJECT_M)


def most_trusted(objects: Sequence[SeenObject], pixels: Sequence[np.ndarray]) -> list[int]:
    """Of objects that lie over each other in one frame those that can be trusted most, the largest first.

    pixels: (M,) of each object. One after the other is kept, the most trusted first, unless too much of it is taken.
    """
    free = np.ones(1 + max((int(each.max()) for each in pixels), default=0), bool)
    kept = []
    for k in sorted(range(len(objects)), key=lambda k: -objects[k].trust):
        if np.count_nonzero(free[pixels[k]]) >= (1.0 - _OVERLAP) * len(pixels[k]):
            free[pixels[k]] = False
            kept.append(k)
    return sorted(kept, key=lambda k: -len(pixels[k]))


def _shared(one: SeenObject, other: SeenObject) -> tuple[float, float]:
    """The share of each one's points that lie within _SAME_PLACE_M of the other's."""
    a, b = (each.points[:: max(1, len(each.points) // _COMPARED)] for each in (one, other))
    if (a.min(axis=0) > b.max(axis=0) + _SAME_PLACE_M).any() or (b.min(axis=0) > a.max(axis=0) + _SAME_PLACE_M).any():
        return 0.0, 0.0
    shares = [cKDTree(q).query(p, distance_upper_bound=_SAME_PLACE_M)[0] for p, q in ((a, b), (b, a))]
    return tuple(float(np.isfinite(each).mean()) for each in shares)  # type: ignore[return-value]


def class_probabilities(classifier: Any, clouds: Sequence[np.ndarray]) -> list[dict[str, float]]:
    """What a classifier says of clouds (M, 3), camera frame: class → probability; nothing of those with few points.

    ``classifier`` is a `pec.Classifier`, which takes all of them at once, or any callable cloud → (label, confidence).
    Where it says how likely a cloud is of one of its classes (`Prediction.known`), the rest is UNKNOWN's.
    """
    least = getattr(classifier, "n_points", 1)
    known = [k for k, cloud in enumerate(clouds) if len(cloud) >= least]
    result: list[dict[str, float]] = [{} for _ in clouds]
    if known and hasattr(classifier, "predict"):
        answers = classifier.predict([clouds[k] for k in known])
        for k, answer in zip(known, answers, strict=True):
            score = getattr(answer, "known", None)
            # One that was trained without strangers gives its confidence: that is no second witness.
            is_known = 1.0 if score is None or score == answer.confidence else float(score)
            result[k] = {name: is_known * float(p) for name, p in answer.probabilities.items()}
            if is_known < 1.0:
                result[k][UNKNOWN] = 1.0 - is_known
    else:
        for k in known:
            label, confidence = classifier(clouds[k])
            result[k] = {label: float(confidence), OTHER: 1.0 - float(confidence)}
    return result
