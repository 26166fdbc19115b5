"""A second witness of what a cloud is: small dense networks that read its size and the forms of its surface.

The network that reads ordered points and this one err on different things, so their probabilities are multiplied, as
those of independent evidence are, the network's raised to what it is worth beside this one. It is fitted in seconds,
after the network (`pec.training.form_fit`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from pec.known.shape_distribution import N_DESCRIPTORS, describe_cloud
from pec.known.surface_forms import N_FORMS, surface_forms

__all__ = ["N_NUMBERS", "FormWitness", "form_numbers"]

N_NUMBERS = N_DESCRIPTORS + N_FORMS

_LEAST = 1e-3  # m, added to lengths whose logarithm is taken
_FARTHEST = 5.0  # standard deviations from the mean, beyond which a number counts as that


def form_numbers(samples: Sequence[np.ndarray], descriptors: np.ndarray | None = None) -> np.ndarray:
    """(B, 115) of the candidates (K, 3) of B clouds: the logarithms of the shape distribution's lengths, and the forms.

    descriptors (B, 37): as `pec.known.evidence.described` has them, where they are at hand.
    """
    if descriptors is None:
        descriptors = np.array([describe_cloud(sample) for sample in samples]).reshape(-1, N_DESCRIPTORS)
    forms = np.array([surface_forms(sample) for sample in samples]).reshape(-1, N_FORMS)
    return np.concatenate([np.log(descriptors + _LEAST), forms], axis=1)


@dataclass(frozen=True)
class FormWitness:
    """mean, unit (115,): numbers are standardised by these. Of M networks the weights (M, n_in, n_out) and biases
    (M, 1, n_out) of three layers, with rectified linear units between them; n_out of the last: outputs of the network
    beside which it stands. network_weight (1,): how much the logarithms of that network's probabilities count beside
    these, as things say that neither learnt from; 1 in checkpoints of earlier versions."""

    mean: np.ndarray
    unit: np.ndarray
    weights_1: np.ndarray
    bias_1: np.ndarray
    weights_2: np.ndarray
    bias_2: np.ndarray
    weights_3: np.ndarray
    bias_3: np.ndarray
    network_weight: np.ndarray = field(default_factory=lambda: np.ones(1))

    def log_probabilities(self, numbers: np.ndarray) -> np.ndarray:
        """(B, O) of numbers (B, 115): of the mean of the probabilities that the M networks give."""
        x = np.clip((numbers - self.mean) / self.unit, -_FARTHEST, _FARTHEST).astype(np.float32)
        hidden = np.maximum(x @ self.weights_1 + self.bias_1, 0)
        hidden = np.maximum(hidden @ self.weights_2 + self.bias_2, 0)
        logits = (hidden @ self.weights_3 + self.bias_3).astype(np.float64)
        logits -= logits.max(axis=2, keepdims=True)
        shares = np.exp(logits)
        shares /= shares.sum(axis=2, keepdims=True)
        return np.log(np.maximum(shares.mean(axis=0), 1e-12))

    def tensors(self) -> dict[str, np.ndarray]:
        """All of it, for a file."""
        return {each.name: np.ascontiguousarray(getattr(self, each.name)) for each in fields(self)}

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, np.ndarray]) -> FormWitness:
        """The inverse of `tensors`; raises KeyError where one is missing."""
        there = {"network_weight": np.ones(1)} | dict(tensors)
        return cls(**{each.name: there[each.name] for each in fields(cls)})
