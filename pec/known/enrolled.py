"""Classes that were shown and not trained: what is nearest to one of a few clouds is of their class.

Nearest by the shape distribution alone. Measured among twenty things that no training knew, with eight clouds of each,
the features of the network made it no better, and neither did copies of the clouds with pieces taken out nor a linear
classifier fitted on both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

__all__ = ["Enrolled", "Nearness", "fit_nearness"]

_COUNTS = np.array([1, 2, 4, 8, 16, 32])  # of clouds of a thing that it is measured for
_ORDINARY = 8
_REJECTED = 0.05  # share of a thing's other clouds, with so many shown
_DRAWS = 4
_MOST_GROUPS = 200  # that are compared: more take longer and show nothing new
_SMALLEST = 1e-3  # of a distance, whose logarithm is taken
_HOPELESS = 50.0


@dataclass(frozen=True)
class Nearness:
    """What a distance to the nearest of n clouds of a thing says, from things that were not trained on.

    mean, deviation (37,): descriptors are standardised by these. typical (6,): mean log distance of other clouds of
    the same thing, for 1, 2, 4 … 32 clouds. slope (< 0), offset: of the log odds that a cloud is of the thing, over
    what its log distance is beyond the typical one, as `known` and its threshold have it. middle: where beyond the
    typical one a cloud is as likely of another thing.
    """

    mean: np.ndarray
    deviation: np.ndarray
    typical: np.ndarray
    slope: float
    offset: float
    middle: float

    def standard(self, descriptors: np.ndarray) -> np.ndarray:
        """Descriptors (B, 37) in the units in which distances are measured."""
        return (descriptors - self.mean) / self.deviation

    def beyond(self, distances: np.ndarray, n_clouds: int) -> np.ndarray:
        """(B,) how far the log distances (B,) to the nearest of `n_clouds` of a class are beyond what is typical."""
        return np.log(distances + _SMALLEST) - np.interp(np.log(n_clouds), np.log(_COUNTS), self.typical)

    def tensors(self) -> dict[str, np.ndarray]:
        """All of it, for a file."""
        return {f"nearness.{each.name}": np.atleast_1d(getattr(self, each.name)) for each in fields(self)}

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, np.ndarray]) -> Nearness:
        """The inverse of `tensors`; raises KeyError where one is missing."""
        names = [each.name for each in fields(cls)]
        mean, deviation, typical, slope, offset = (tensors[f"nearness.{name}"] for name in names[:5])
        # Checkpoints of earlier versions took both odds for one.
        middle = tensors.get("nearness.middle", -offset / slope)
        return cls(mean, deviation, typical, float(slope[0]), float(offset[0]), float(middle[0]))


@dataclass(frozen=True)
class Enrolled:
    """names: of the classes, in the order in which they were shown. descriptors: of each class's clouds (n, 37)."""

    names: tuple[str, ...] = ()
    descriptors: tuple[np.ndarray, ...] = ()

    def with_class(self, name: str, descriptors: np.ndarray) -> Enrolled:
        return Enrolled((*self.names, name), (*self.descriptors, descriptors))

    def beyond(self, nearness: Nearness, descriptors: np.ndarray) -> np.ndarray:
        """(B, E): how far the clouds are from each class's, beyond what is typical of other clouds of one thing."""
        looked_at = nearness.standard(descriptors)
        beyond = np.empty((len(descriptors), len(self.names)))
        for column, shown in enumerate(self.descriptors):
            away = np.linalg.norm(looked_at[:, None] - nearness.standard(shown), axis=2).min(axis=1)
            beyond[:, column] = nearness.beyond(away, len(shown))
        return beyond

    def answer(
        self, nearness: Nearness, descriptors: np.ndarray, probabilities: np.ndarray, known: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Probabilities (B, C + E) of the trained and these classes, and `known` (B,), of those of the trained ones.

        All classes are as likely before anything is seen: the trained ones, which share the odds that the cloud is of
        one of them at all as the network says, weigh as many as they are. What is likeliest decides how well a cloud
        is known, each by its own threshold's odds.
        """
        trained = np.log(np.maximum(known, 1e-12)) - np.log(np.maximum(1 - known, 1e-12))
        beyond = self.beyond(nearness, descriptors)
        odds = np.concatenate([trained[:, None], nearness.slope * (beyond - nearness.middle)], axis=1)
        odds[:, 0] += np.log(probabilities.shape[1])
        odds = np.clip(odds, -_HOPELESS, _HOPELESS)
        shares = np.exp(odds - odds.max(axis=1, keepdims=True))
        shares /= shares.sum(axis=1, keepdims=True)
        joined = np.concatenate([shares[:, :1] * probabilities, shares[:, 1:]], axis=1)
        passing = np.concatenate([trained[:, None], nearness.slope * beyond + nearness.offset], axis=1)
        own = np.take_along_axis(passing, odds.argmax(axis=1)[:, None], axis=1)[:, 0]
        return joined, 1 / (1 + np.exp(-np.clip(own, -_HOPELESS, _HOPELESS)))


def fit_nearness(descriptors: np.ndarray, things: np.ndarray, threshold: float, seed: int = 0) -> Nearness:
    """From descriptors (n, 37) of clouds of `things` (n,), two of them at least with two clouds.

    threshold: of `known`; 95 in 100 clouds of a thing pass it where eight others were shown.
    """
    rng = np.random.default_rng(seed)
    mean, deviation = descriptors.mean(axis=0), descriptors.std(axis=0) + 1e-6
    standard = (descriptors - mean) / deviation
    names, counts = np.unique(things, return_counts=True)
    names = rng.permutation(names[counts > 1])[:_MOST_GROUPS]
    groups = [standard[things == name] for name in names]
    near: dict[int, list[np.ndarray]] = {n: [] for n in _COUNTS.tolist()}
    far: dict[int, list[np.ndarray]] = {n: [] for n in _COUNTS.tolist()}
    for _ in range(_DRAWS):
        for place, group in enumerate(groups):
            group = rng.permutation(group)
            other = groups[(place + int(rng.integers(1, len(groups)))) % len(groups)]
            for n in _COUNTS.tolist():
                if n < len(group):
                    shown, rest = group[:n], group[n:]
                    near[n].append(_log_nearest(rest, shown))
                    far[n].append(_log_nearest(other, shown))
    typical = _typical({n: float(np.mean(np.concatenate(values))) for n, values in near.items() if values})
    beyond = [
        np.concatenate(
            [np.concatenate(values) - typical[place] for place, values in enumerate(each.values()) if values]
        )
        for each in (near, far)
    ]
    slope = _slope(*beyond)
    # Where eight clouds are too many for the things at hand, by as many as there can be.
    n = max(n for n in near if near[n] and n <= _ORDINARY)
    passing = np.quantile(np.concatenate(near[n]) - typical[_COUNTS.tolist().index(n)], 1 - _REJECTED)
    wanted = np.log(max(threshold, 1e-6)) - np.log(max(1 - threshold, 1e-6))
    middle = 0.5 * float(beyond[0].mean() + beyond[1].mean())
    return Nearness(mean, deviation, typical, slope, float(wanted - slope * passing), middle)


def _typical(measured: Mapping[int, float]) -> np.ndarray:
    """(6,) from mean log distances for some of the counts: the more clouds, the nearer is the nearest, by as much for
    each doubling beyond those that could be measured as within them.
    """
    at, values = np.log(list(measured)), np.array(list(measured.values()))
    fall = min(float(np.polyfit(at, values, 1)[0]), 0.0) if len(at) > 1 else 0.0
    counts = np.log(_COUNTS)
    return np.where(counts <= at[-1], np.interp(counts, at, values), values[-1] + fall * (counts - at[-1]))


def _log_nearest(clouds: np.ndarray, shown: np.ndarray) -> np.ndarray:
    return np.log(np.linalg.norm(clouds[:, None] - shown, axis=2).min(axis=1) + _SMALLEST)


def _slope(near: np.ndarray, far: np.ndarray) -> float:
    """Of a logistic model of one number: between two normal distributions of one variance, as Fisher's."""
    variance = 0.5 * (near.var() + far.var()) + 1e-6
    return float(-max((far.mean() - near.mean()) / variance, 0.1))
