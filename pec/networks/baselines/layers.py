"""The layers that these networks share: dense, batch-normalised and activated, for every point alike; residuals."""

from __future__ import annotations

import itertools

import torch
from torch import nn

__all__ = ["Residual", "Shared", "shared_mlp"]


class Shared(nn.Module):
    """(…, c_in) → (…, c_out); every row is treated alike, batch norm takes its statistics over all of them.

    Rows of channels, not channels of rows as a Conv1d of width 1 has them: on a CPU half the time or less.
    """

    def __init__(self, c_in: int, c_out: int, *, bias: bool = True, slope: float = 0.0) -> None:
        """slope: of the activation where its input is negative; 0 is ReLU."""
        super().__init__()
        self.linear = nn.Linear(c_in, c_out, bias=bias)
        self.norm = nn.BatchNorm1d(c_out)
        self.activation = nn.LeakyReLU(slope) if slope else nn.ReLU()

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        rows = self.linear(x).flatten(0, -2)
        return self.activation(self.norm(rows)).view(*x.shape[:-1], -1)


class Residual(nn.Module):
    """(…, width) → (…, width): relu(x + f(x)), f through a quarter of the width; every row is treated alike."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.narrow = Shared(width, width // 4, bias=False)
        self.wide = nn.Linear(width // 4, width, bias=False)
        self.norm = nn.BatchNorm1d(width)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        rows = self.norm(self.wide(self.narrow(x)).flatten(0, -2))
        return torch.relu(rows.view(x.shape) + x)


def shared_mlp(*widths: int) -> nn.Sequential:
    """Several `Shared` layers of the given widths, the first of which is the input's."""
    return nn.Sequential(*(Shared(c_in, c_out) for c_in, c_out in itertools.pairwise(widths)))
