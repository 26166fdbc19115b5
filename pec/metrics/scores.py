"""Predictions against what the clouds are of: accuracy, cross-entropy, confusion, calibration."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from pec.metrics.calibration import expected_calibration_error
from pec.metrics.predictions import among_known

__all__ = ["Scores", "score"]


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
