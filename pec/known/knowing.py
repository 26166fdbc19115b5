"""One probability that a cloud is of a known class, from all that speaks for and against it.

A logistic model of the scores of `pec.known.evidence`: no weight of it is of the wrong sign, so more strange by any
score is never more known. It is calibrated for as many strangers as known things.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from pec.known.evidence import Answers, Prototypes, scores

__all__ = ["Knowing"]


_HOPELESS = 50.0  # log odds, below which floats say nothing


@dataclass(frozen=True)
class Knowing:
    """centre, unit (S,): scores are taken in units from the centre. weights (S,) ≤ 0 and bias of the logistic."""

    prototypes: Prototypes
    centre: np.ndarray
    unit: np.ndarray
    weights: np.ndarray
    bias: float

    def known(self, answers: Answers) -> np.ndarray:
        """(B,) probabilities in [0, 1] that the clouds are of one of the classes."""
        return self.of_scores(scores(answers, self.prototypes))

    def of_scores(self, values: np.ndarray) -> np.ndarray:
        """As `known`, of scores (B, S)."""
        odds = ((values - self.centre) / self.unit) @ self.weights + self.bias
        return 1 / (1 + np.exp(-np.maximum(odds, -_HOPELESS)))

    def tensors(self) -> dict[str, np.ndarray]:
        """All of it, for a file."""
        own = {"centre": self.centre, "unit": self.unit, "weights": self.weights, "bias": np.array([self.bias])}
        return own | {f"prototypes.{each.name}": getattr(self.prototypes, each.name) for each in fields(Prototypes)}

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, np.ndarray]) -> Knowing:
        """The inverse of `tensors`; raises KeyError where one is missing."""
        prototypes = Prototypes(**{each.name: tensors[f"prototypes.{each.name}"] for each in fields(Prototypes)})
        return cls(
            prototypes, tensors["centre"], tensors["unit"], tensors["weights"], float(tensors["bias"].ravel()[0])
        )
