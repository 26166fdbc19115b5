"""PEC, the published network: an autoencoder-shaped classifier that reads the points of a cloud as channels.

Source: the dissertation of PEC and the sources its author released. x, y, z is a signal of length 3 and point i is
channel i, so all that the network knows of a point's place is the order in which it comes (see
`pec.preprocessing.preprocess`).
At 64 points and 5 classes: 890,501 parameters, about 2.3 million multiply-adds a cloud.

A signal of length 3 is too short for convolution kernels, on a CPU above all: here each convolution is products of
matrices, the same function of the same parameters, three to four times as fast to train. In training
`pec.networks.short_convolution` makes them; what stands here is plain, can be exported, and computes all that the
published layers do, products with the padding's zeros included.
"""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from pec.networks.short_convolution import convolve

__all__ = ["PEC", "ConvTranspose1d"]


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
            _Conv1d(n, 4 * n, 3, padding=1),
            _BatchNorm1d(4 * n),
            nn.ReLU(),
            _Conv1d(4 * n, 8 * n, 3, padding=1),
            _BatchNorm1d(8 * n),
            nn.ReLU(),
            _Conv1d(8 * n, n, 3, padding=1),
            _BatchNorm1d(n),
            nn.ReLU(),
            _Flatten(),
            nn.Linear(3 * n, n // 2),
        )
        self.decoder = nn.Sequential(
            nn.Linear(n // 2, n),
            nn.Unflatten(1, (1, n)),
            ConvTranspose1d(n, 4 * n, 2),
            nn.ReLU(),
            ConvTranspose1d(4 * n, 8 * n, 2),
            nn.ReLU(),
            ConvTranspose1d(8 * n, n, 1),
            nn.Sigmoid(),
        )
        self.head = nn.Sequential(
            _Conv1d(n, n // 2, 1),
            nn.ReLU(),
            _Flatten(),
            nn.Linear(3 * n // 2, n),
            nn.ReLU(),
            nn.Linear(n, n // 2),
            nn.ReLU(),
            nn.Linear(n // 2, n_classes),
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, n_points, 3) ordered, centred points in metres → (B, n_classes) logits."""
        return self.head(self.decoder(self.encoder(points.transpose(1, 2))))


class _Conv1d(nn.Conv1d):
    """nn.Conv1d of signals (B, length, channels)."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        taps, length = self.kernel_size[0], x.shape[1]
        if taps > 1 and self.training:
            assert self.bias is not None
            return convolve(x, self.weight.transpose(1, 2), self.bias, length, before=taps // 2)
        if taps > 1:
            padded = functional.pad(x, (0, 0, taps // 2, taps // 2))
            x = torch.cat([padded[:, tap : tap + length] for tap in range(taps)], dim=2)
        return functional.linear(x, self.weight.permute(0, 2, 1).flatten(1), self.bias)


class ConvTranspose1d(nn.ConvTranspose1d):
    """nn.ConvTranspose1d of signals (B, length, channels)."""

    def forward(self, x: torch.Tensor, output_size: list[int] | None = None) -> torch.Tensor:
        taps, length = self.kernel_size[0], x.shape[1]
        assert self.bias is not None
        if taps > 1 and self.training:
            # Output o takes input o - tap: windows that end at o, the last tap first.
            weight = self.weight.permute(1, 2, 0).flip(1)
            return convolve(x, weight, self.bias, length + taps - 1, before=taps - 1)
        products = (x @ self.weight.permute(0, 2, 1).flatten(1)).unflatten(2, (taps, -1))
        # Input i adds to output i + tap through each tap.
        y = functional.pad(products[:, :, 0], (0, 0, 0, taps - 1))
        for tap in range(1, taps):
            y = y + functional.pad(products[:, :, tap], (0, 0, tap, taps - 1 - tap))
        return y + self.bias


class _BatchNorm1d(nn.BatchNorm1d):
    """nn.BatchNorm1d of signals (B, length, channels)."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return super().forward(x.flatten(0, 1)).view_as(x)


class _Flatten(nn.Module):
    """(B, length, channels) → (B, channels · length), the channel slowest, as published."""

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x.transpose(1, 2).flatten(1)
