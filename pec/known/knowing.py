"""One probability that a cloud is of a known class, from all that speaks for and against it.

A logistic model of the scores of `pec.known.evidence`: no weight of it is of the wrong sign, so more strange by any
score is never more known. It is calibrated for as many strangers as known things.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from pec.known.enrolled import Nearness
from pec.known.evidence import Answers, Prototypes, scores

__all__ = ["Knowing", "logistic"]


_HOPELESS = 50.0  # log odds, below which floats say nothing


def logistic(values: np.ndarray, centre: np.ndarray, unit: np.ndarray, weights: np.ndarray, bias: float) -> np.ndarray:
    """(B,) probabilities of scores (B, S)."""
    odds = ((values - centre) / unit) @ weights + bias
    return 1 / (1 + np.exp(-np.maximum(odds, -_HOPELESS)))


@dataclass(frozen=True)
class Knowing:
    """centre, unit (S,): scores are taken in units from the centre. weights (S,) ≤ 0 and bias of the logistic model.
    nearness: what tells the clouds of one thing from others', for classes that are shown later."""

    prototypes: Prototypes
    centre: np.ndarray
    unit: np.ndarray
    weights: np.ndarray
    bias: float
    nearness: Nearness

    def known(self, answers: Answers) -> np.ndarray:
        """(B,) probabilities in [0, 1] that the clouds are of one of the classes."""
        return logistic(scores(answers, self.prototypes), self.centre, self.unit, self.weights, self.bias)

    def tensors(self) -> dict[str, np.ndarray]:
        """All of it, for a file."""
        own = {"centre": self.centre, "unit": self.unit, "weights": self.weights, "bias": np.array([self.bias])}
        own |= self.nearness.tensors()
        return own | {f"prototypes.{each.name}": getattr(self.prototypes, each.name) for each in fields(Prototypes)}

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, np.ndarray]) -> Knowing:
        """The inverse of `tensors`; raises KeyError where one is missing."""
        prototypes = Prototypes(**{each.name: tensors[f"prototypes.{each.name}"] for each in fields(Prototypes)})
        return cls(
            prototypes,
            tensors["centre"],
            tensors["unit"],
            tensors["weights"],
            float(tensors["bias"].ravel()[0]),
            Nearness.from_tensors(tensors),
        )
