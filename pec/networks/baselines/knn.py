"""The floor: nearest neighbours among the training clouds by a few rotation-invariant numbers.

Descriptor of a cloud: quantiles of the distances between all pairs of points and of those to the centroid (D2 and D1 of
Osada, Funkhouser, Chazelle, Dobkin, "Shape Distributions", ACM TOG 2002, there as histograms), and the spread along the
principal axes; each number standardised over the training clouds. There is no gradient: `fit` keeps the training
clouds, and the number of neighbours that vote is chosen by leave-one-out among them.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.networks.baselines.memorising import Memorising
from pec.networks.baselines.neighbourhoods import squared_distances

__all__ = ["NearestNeighbours", "describe"]

_QUANTILES = torch.linspace(0.0, 1.0, 17)
_VOTERS = (1, 3, 5, 9, 15)
_BLOCK = 512  # clouds at once: bounds memory, changes no result


def describe(points: torch.Tensor) -> torch.Tensor:
    """(B, N, 3) points in any order and orientation → (B, 37) descriptors, metres."""
    return torch.cat([_describe(block) for block in points.split(_BLOCK)])


def _describe(points: torch.Tensor) -> torch.Tensor:
    n = points.shape[1]
    centred = points - points.mean(dim=1, keepdim=True)
    upper = torch.triu_indices(n, n, 1, device=points.device)
    pairs = (centred[:, upper[0]] - centred[:, upper[1]]).norm(dim=2)
    axes = torch.linalg.eigvalsh((centred.transpose(1, 2) @ centred / n).double().cpu()).clamp_min(0).sqrt()
    return torch.cat([_quantiles(pairs), _quantiles(centred.norm(dim=2)), axes.to(points)], dim=1)


def _quantiles(values: torch.Tensor) -> torch.Tensor:
    place = (_QUANTILES * (values.shape[1] - 1)).round().long()
    return values.sort(dim=1).values[:, place.to(values.device)]


class NearestNeighbours(Memorising):
    """Votes of the nearest training clouds. Called like a network, and kept in a checkpoint like one."""

    _sized = ("mean", "spread", "known", "labels")

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        self.n_classes = n_classes
        for name in ("mean", "spread", "known"):
            self.register_buffer(name, torch.empty(0))
        self.register_buffer("labels", torch.empty(0, dtype=torch.int64))
        self.register_buffer("voters", torch.tensor(1))

    @torch.no_grad()
    def fit(self, points: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Keep the clouds (n, N, 3) of known `labels` (n,), n > 1; returns their log-probabilities (n, n_classes), each
        by the others (leave-one-out)."""
        descriptors = describe(points)
        self.mean, self.spread = descriptors.mean(dim=0), descriptors.std(dim=0).clamp_min(1e-12)
        self.known, self.labels = (descriptors - self.mean) / self.spread, labels.clone()
        distances = squared_distances(self.known[None], self.known[None])[0].fill_diagonal_(torch.inf)
        nearest = distances.topk(min(max(_VOTERS), len(labels) - 1), dim=1, largest=False).indices
        shares = {k: self._shares(nearest[:, :k]) for k in _VOTERS if k <= nearest.shape[1]}
        best = max(shares, key=lambda k: int((shares[k].argmax(dim=1) == labels).sum()))
        self.voters = torch.tensor(best, device=points.device)
        return shares[best].log()

    def embed(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, N, 3) points → `forward`'s logarithms, and the standardised descriptors (B, 37)."""
        descriptors = (describe(points) - self.mean) / self.spread
        distances = squared_distances(descriptors[None], self.known[None])[0]
        nearest = distances.topk(int(self.voters), dim=1, largest=False).indices
        return self._shares(nearest).log(), descriptors

    def _shares(self, nearest: torch.Tensor) -> torch.Tensor:
        """(B, k) indices of neighbours → (B, n_classes) shares of the votes, one vote more for every class (Laplace).

        Of classes with equally many votes the one with the nearest neighbour wins: it votes a little more.
        """
        votes = nn.functional.one_hot(self.labels[nearest], self.n_classes).to(torch.float32)
        votes[:, 0] *= 1.5
        counts = votes.sum(dim=1) + 1
        return counts / counts.sum(dim=1, keepdim=True)
