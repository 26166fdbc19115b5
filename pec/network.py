"""PEC, the published network: an autoencoder-shaped classifier that reads the points of a cloud as channels.

Source: the dissertation of PEC and the sources its author released. x, y, z is a signal of length 3 and point i is
channel i, so all that the network knows of a point's place is the order in which it comes (see `pec.preprocess`).
At 64 points and 5 classes: 890,501 parameters, about 2.3 million multiply-adds a cloud.
"""

from __future__ import annotations

import torch
from torch import nn

__all__ = ["PEC"]


class PEC(nn.Module):
    """Published PEC for clouds of `n_points` points and `n_classes` classes; n_points is a multiple of 2.

    Encoder: three Conv1d with batch norm and a bottleneck of n_points / 2; decoder: three ConvTranspose1d; head: a
    pointwise convolution and three dense layers. No dropout, no skips, no reconstruction loss.
    """

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        n = n_points
        self.n_points = n_points
        self.n_classes = n_classes
        self.encoder = nn.Sequential(
            nn.Conv1d(n, 4 * n, 3, padding=1),
            nn.BatchNorm1d(4 * n),
            nn.ReLU(),
            nn.Conv1d(4 * n, 8 * n, 3, padding=1),
            nn.BatchNorm1d(8 * n),
            nn.ReLU(),
            nn.Conv1d(8 * n, n, 3, padding=1),
            nn.BatchNorm1d(n),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(3 * n, n // 2),
        )
        self.decoder = nn.Sequential(
            nn.Linear(n // 2, n),
            nn.Unflatten(1, (n, 1)),
            nn.ConvTranspose1d(n, 4 * n, 2),
            nn.ReLU(),
            nn.ConvTranspose1d(4 * n, 8 * n, 2),
            nn.ReLU(),
            nn.ConvTranspose1d(8 * n, n, 1),
            nn.Sigmoid(),
        )
        self.head = nn.Sequential(
            nn.Conv1d(n, n // 2, 1),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(3 * n // 2, n),
            nn.ReLU(),
            nn.Linear(n, n // 2),
            nn.ReLU(),
            nn.Linear(n // 2, n_classes),
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, n_points, 3) ordered, centred points in metres → (B, n_classes) logits."""
        return self.head(self.decoder(self.encoder(points)))
