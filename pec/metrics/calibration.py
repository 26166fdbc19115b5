"""Whether confidences are shares of right answers: the expected calibration error, and a temperature that mends it."""

from __future__ import annotations

import math

import torch

__all__ = ["expected_calibration_error", "fit_temperature"]


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
