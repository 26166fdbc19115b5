"""How well a score tells known clouds from strangers, and below which one to refuse."""

from __future__ import annotations

import math

import numpy as np
import torch

__all__ = ["UNSEEN_REJECTED", "area_under_roc", "rejection_threshold"]

UNSEEN_REJECTED = 0.05
"""Share of clouds of unseen instances of the known classes that may be called unknown."""


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
