"""What speaks for and against a cloud's being of a known class, before it is weighed.

Each score is larger the stranger a cloud is. Chosen on other things than the catalogue draws; what was left out beside
these (largest probability, disagreement of the views, Mahalanobis distance) added nothing to them:

none of these   log of p(none of these) over that of the likeliest class; only of a network that learnt from strangers
energy          minus the logarithm of the sum of the exponentiated logits of the classes (Liu et al., NeurIPS 2020)
features        log distance of the features to the nearest prototype of the likeliest class (as Sun et al., "Deep
                nearest neighbors", ICML 2022), measured by the covariance within classes (Lee et al., NeurIPS 2018)
shape           the same of the shape distribution, each number in units of its deviation over the training clouds
size            log of 1 + the squared Mahalanobis distance of the log spreads along the axes to the likeliest class's
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from pec.known.shape_distribution import N_AXES, N_DESCRIPTORS, describe_cloud

__all__ = ["SCORES", "Answers", "Prototypes", "answers_of", "described", "log_size", "scores", "tempered"]

SCORES = ("none of these", "energy", "features", "shape", "size")

_SMALLEST = 1e-6
_NOTHING = 1e-300
_UNLIKELY = 40.0  # of a logarithm of two probabilities: beyond, float32 says nothing


@dataclass(frozen=True)
class Answers:
    """What is seen of B clouds. logits (B, V, O) of V views, the first `n_classes` of the O those of the known classes;
    features (B, F), mean over the views; descriptors (B, 37) of `shape_distribution.describe_cloud`; float64. by_form
    (B, O): log probabilities by the witness of forms, where there is one, and network_weight what the network counts
    beside it."""

    logits: np.ndarray
    features: np.ndarray
    descriptors: np.ndarray
    n_classes: int
    by_form: np.ndarray | None = None
    network_weight: float = 1.0

    @cached_property
    def log_probabilities(self) -> np.ndarray:
        """(B, O): of the mean probability over the views, as `average_views`, to the power of its weight, times the
        other witness's."""
        said = np.log(np.maximum((self._shares / self._sums).sum(axis=1) / self.logits.shape[1], _NOTHING))
        if self.by_form is None:
            return said
        said = self.network_weight * said + self.by_form
        most = said.max(axis=1, keepdims=True)
        return said - most - np.log(np.exp(said - most).sum(axis=1, keepdims=True))

    @cached_property
    def energies(self) -> np.ndarray:
        """(B,): mean over the views of minus the logarithm of the sum of the exponentiated logits of the classes."""
        of_known = np.maximum(self._shares[:, :, : self.n_classes].sum(axis=2), _NOTHING)
        return -(np.log(of_known) + self._most[:, :, 0]).sum(axis=1) / self.logits.shape[1]

    @cached_property
    def _most(self) -> np.ndarray:
        return self.logits.max(axis=2, keepdims=True)

    @cached_property
    def _shares(self) -> np.ndarray:
        return np.exp(self.logits - self._most)

    @cached_property
    def _sums(self) -> np.ndarray:
        return self._shares.sum(axis=2, keepdims=True)

    def __getitem__(self, index: np.ndarray | slice) -> Answers:
        by_form = None if self.by_form is None else self.by_form[index]
        parts = self.logits[index], self.features[index], self.descriptors[index]
        return Answers(*parts, self.n_classes, by_form, self.network_weight)


def answers_of(
    logits: torch.Tensor,
    features: torch.Tensor,
    descriptors: np.ndarray,
    n_classes: int,
    n_views: int,
    by_form: np.ndarray | None = None,
    network_weight: float = 1.0,
) -> Answers:
    """Of a network's outputs (B · V, O) and (B · V, F), on the CPU, for all views of B clouds, the clouds' descriptors
    (B, 37), and what the witness of forms says of them (B, O), where there is one, with the network's weight beside
    it."""
    by_view = logits.numpy().astype(np.float64).reshape(-1, n_views, logits.shape[1])
    of_views = features.numpy().reshape(-1, n_views, features.shape[1])
    features_of_clouds = of_views.sum(axis=1, dtype=np.float64) / n_views
    return Answers(by_view, features_of_clouds, descriptors, n_classes, by_form, network_weight)


def described(samples: Sequence[np.ndarray]) -> np.ndarray:
    """(B, 37) descriptors of B clouds' candidates (K, 3)."""
    return np.array([describe_cloud(sample) for sample in samples]).reshape(-1, N_DESCRIPTORS)


def tempered(log_probabilities: np.ndarray, temperature: float) -> np.ndarray:
    """(B, C) probabilities, sum 1, of logarithms (B, C) that need not be normalised."""
    scaled = log_probabilities / temperature
    raised = np.exp(scaled - scaled.max(axis=1, keepdims=True))
    return raised / raised.sum(axis=1, keepdims=True)


@dataclass(frozen=True)
class Prototypes:
    """Of C classes, K prototypes each. metric (F, F): features times it are measured; features (C, K, F) in that
    metric; mean and deviation (37,) of descriptors; shapes (C, K, 37) so standardised; log_size (C, 3) means;
    size_metric (C, 3, 3) inverse covariances."""

    metric: np.ndarray
    features: np.ndarray
    mean: np.ndarray
    deviation: np.ndarray
    shapes: np.ndarray
    log_size: np.ndarray
    size_metric: np.ndarray


def scores(answers: Answers, prototypes: Prototypes) -> np.ndarray:
    """(B, 5) in the order of SCORES."""
    n, said = answers.n_classes, answers.log_probabilities
    known = said[:, :n]
    likeliest = known.argmax(axis=1)
    out = np.zeros((len(said), len(SCORES)))
    if said.shape[1] > n:
        out[:, 0] = np.minimum(np.maximum(said[:, n] - known.max(axis=1), -_UNLIKELY), _UNLIKELY)
    out[:, 1] = answers.energies
    out[:, 2] = _nearest(answers.features @ prototypes.metric, prototypes.features[likeliest])
    shapes = (answers.descriptors - prototypes.mean) / prototypes.deviation
    out[:, 3] = _nearest(shapes, prototypes.shapes[likeliest])
    away = log_size(answers.descriptors) - prototypes.log_size[likeliest]
    out[:, 4] = (away[:, None] @ prototypes.size_metric[likeliest] @ away[:, :, None])[:, 0, 0]
    out[:, 2:4] = 0.5 * np.log(out[:, 2:4] + _SMALLEST)
    out[:, 4] = np.log1p(out[:, 4])
    return out


def log_size(descriptors: np.ndarray) -> np.ndarray:
    """(B, 3) logarithms of the spreads along the principal axes; of a plate's thickness, a tenth of a millimetre."""
    return np.log(np.maximum(descriptors[:, -N_AXES:], 1e-4))


def _nearest(vectors: np.ndarray, of_each: np.ndarray) -> np.ndarray:
    """(B,) squared distances of vectors (B, D) to the nearest of their K prototypes (B, K, D)."""
    away = of_each - vectors[:, None]
    away *= away
    return away.sum(axis=2).min(axis=1)
