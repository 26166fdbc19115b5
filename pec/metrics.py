"""Predictions over many clouds, and what they are worth: accuracy, confusion, calibration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from pec.known.form_witness import FormWitness, form_numbers
from pec.networks.registry import fast_forward
from pec.preprocessing.preprocess import Preprocess

__all__ = [
    "UNSEEN_REJECTED",
    "Scores",
    "among_known",
    "area_under_roc",
    "arrange_views",
    "expected_calibration_error",
    "fit_temperature",
    "log_probabilities",
    "predict_log_probabilities",
    "rejection_threshold",
    "score",
]

UNSEEN_REJECTED = 0.05
"""Share of clouds of unseen instances of the known classes that may be called unknown."""

_BATCH = 512  # clouds at once: bounds memory, changes no result


@dataclass(frozen=True)
class Scores:
    """Accuracy in [0, 1], mean cross-entropy, confusion[truth][prediction] counts, accuracy of each class: of clouds of
    the known classes, among those. strangers_refused: share of the strangers for which "none of these" is likeliest;
    None where there are none. answered: share of all clouds that are right where "none of these" is one more class.
    """

    accuracy: float
    loss: float
    confusion: list[list[int]]
    per_class: list[float]
    calibration_error: float
    strangers_refused: float | None
    answered: float


def predict_log_probabilities(
    model: nn.Module,
    preprocess: Preprocess,
    candidates: torch.Tensor,
    valid: torch.Tensor,
    forms: FormWitness | None = None,
) -> torch.Tensor:
    """(B, n_classes) log-probabilities, untempered: the mean of the probabilities over the equally valid poses, times
    those of the witness of forms where there is one."""
    forward = fast_forward(model)
    blocks = zip(candidates.split(_BATCH), valid.split(_BATCH), strict=True)
    said = torch.cat([_of_block(forward, _views(preprocess, *block)) for block in blocks])
    if forms is None:
        return said
    pairs = zip(candidates.cpu().numpy(), valid.cpu().numpy(), strict=True)
    beside = forms.log_probabilities(form_numbers([points[there] for points, there in pairs]))
    return (said + torch.from_numpy(beside).to(said)).log_softmax(dim=1)


def arrange_views(preprocess: Preprocess, candidates: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    """Inputs (B, V, n_points, 3), one a valid pose, for `log_probabilities`: for clouds that are evaluated often."""
    blocks = zip(candidates.split(_BATCH), valid.split(_BATCH), strict=True)
    return torch.cat([_views(preprocess, *block) for block in blocks])


def log_probabilities(model: nn.Module, inputs: torch.Tensor) -> torch.Tensor:
    """As `predict_log_probabilities`, of inputs that `arrange_views` made."""
    forward = fast_forward(model)
    return torch.cat([_of_block(forward, block) for block in inputs.split(_BATCH)])


def _views(preprocess: Preprocess, candidates: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    n_views = preprocess.n_views
    view = torch.arange(n_views, device=candidates.device).repeat(len(candidates))
    copies = candidates.repeat_interleave(n_views, dim=0), valid.repeat_interleave(n_views, dim=0)
    return preprocess.arrange(*copies, view).unflatten(0, (len(candidates), n_views))


@torch.no_grad()
def _of_block(forward: Callable[[torch.Tensor], torch.Tensor], inputs: torch.Tensor) -> torch.Tensor:
    logits = forward(inputs.flatten(0, 1)).unflatten(0, inputs.shape[:2])
    return average_views(logits.transpose(0, 1))


def average_views(logits: torch.Tensor) -> torch.Tensor:
    """(V, B, C) logits → (B, C) log of the mean probability over the V views."""
    return torch.logsumexp(logits.log_softmax(dim=2), dim=0) - math.log(len(logits))


def among_known(log_probabilities: torch.Tensor, n_classes: int) -> torch.Tensor:
    """(B, n_classes) log-probabilities given that the cloud is of one of the first `n_classes`, the known ones."""
    return log_probabilities[:, :n_classes].log_softmax(dim=1)


def score(
    log_probabilities: torch.Tensor, labels: torch.Tensor, temperature: float = 1.0, n_classes: int | None = None
) -> Scores:
    """Scores of (B, C) log-probabilities against (B,) labels.

    n_classes: the first of the C that are known classes; a label beyond them is a stranger's. None: all C.
    """
    n_classes = log_probabilities.shape[1] if n_classes is None else n_classes
    right, stranger = log_probabilities.argmax(dim=1) == labels, labels >= n_classes
    answered = right.double().mean().item()
    refused = right[stranger].double().mean().item() if stranger.any() else None
    log_probabilities, labels = among_known(log_probabilities[~stranger], n_classes), labels[~stranger]
    tempered = (log_probabilities / temperature).log_softmax(dim=1)
    predicted = tempered.argmax(dim=1)
    confusion = torch.zeros(n_classes, n_classes, dtype=torch.int64)
    confusion.index_put_((labels.cpu(), predicted.cpu()), torch.ones(len(labels), dtype=torch.int64), accumulate=True)
    return Scores(
        accuracy=(predicted == labels).double().mean().item(),
        loss=torch.nn.functional.nll_loss(tempered, labels).item(),
        confusion=confusion.tolist(),
        per_class=(confusion.diag() / confusion.sum(dim=1).clamp_min(1)).tolist(),
        calibration_error=expected_calibration_error(tempered.exp(), labels),
        strangers_refused=refused,
        answered=answered,
    )


def expected_calibration_error(probabilities: torch.Tensor, labels: torch.Tensor, n_bins: int = 15) -> float:
    """Mean |confidence - accuracy| over `n_bins` equal bins of confidence, weighted by their share of samples."""
    confidence, predicted = probabilities.max(dim=1)
    correct = (predicted == labels).to(probabilities.dtype)
    bins = (confidence * n_bins).long().clamp_max(n_bins - 1)
    gap = torch.zeros(n_bins, dtype=probabilities.dtype, device=probabilities.device)
    gap.index_add_(0, bins, confidence - correct)
    return (gap.abs().sum() / len(labels)).item()


def fit_temperature(log_probabilities: torch.Tensor, labels: torch.Tensor) -> float:
    """The temperature in [0.05, 20] that minimises the cross-entropy (Guo et al. 2017), to 1e-6 of its logarithm.

    The cross-entropy is convex in 1 / temperature, so there is one minimum. Of n clouds that were all right it follows
    no more than (n + 1) / (n + 2) (the targets of Platt 1999); without that, the best temperature would be zero.
    """
    from scipy.optimize import minimize_scalar  # slow to import, and only training fits a temperature

    scores = log_probabilities.double()
    n, n_classes = scores.shape
    smoothing = n_classes / ((n_classes - 1) * (n + 2))

    def loss(log_temperature: float) -> float:
        tempered = scores / math.exp(log_temperature)
        return torch.nn.functional.cross_entropy(tempered, labels, label_smoothing=smoothing).item()

    bounds = math.log(0.05), math.log(20)
    return math.exp(minimize_scalar(loss, bounds=bounds, method="bounded", options={"xatol": 1e-6}).x)


def area_under_roc(known: np.ndarray, strangers: np.ndarray) -> float:
    """The chance that a known cloud's score (n,) is greater than a stranger's (m,); equal ones count half."""
    pooled = np.concatenate([known, strangers])
    _, place, counts = np.unique(pooled, return_inverse=True, return_counts=True)
    mean_ranks = np.cumsum(counts) - (counts - 1) / 2
    n, m = len(known), len(strangers)
    return float((mean_ranks[place.reshape(-1)][:n].sum() - n * (n + 1) / 2) / (n * m))


def rejection_threshold(confidences: torch.Tensor, rate: float = UNSEEN_REJECTED) -> float:
    """The score below which at most the share `rate` of known objects fall, from those (n,) of a validation split.

    The k-th smallest, k = ⌊rate · (n + 1)⌋: a new cloud like those falls below it with probability at most k / (n + 1)
    (the rank of one among exchangeable draws, as in split conformal prediction). 0, which rejects nothing, where n is
    too small to promise the rate.
    """
    k = math.floor(rate * (len(confidences) + 1))
    return confidences.sort().values[k - 1].item() if k else 0.0
