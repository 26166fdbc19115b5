"""What is called like a network and has no gradient: it is made of all training clouds at once."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import torch
from torch import nn

__all__ = ["Memorising"]


class Memorising(nn.Module):
    """`_sized`: its buffers whose sizes depend on the training clouds."""

    _sized: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def fit(self, points: torch.Tensor, labels: torch.Tensor) -> torch.Tensor:
        """Take clouds (n, N, 3) of known `labels` (n,), n > 1; returns their log-probabilities (n, n_classes), each by
        the others.
        """

    @abstractmethod
    def embed(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, N, 3) points in any order → `forward`'s logarithms, and numbers (B, F) that describe the clouds."""

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) points in any order → (B, n_classes) logarithms of the shares of the votes."""
        return self.embed(points)[0]

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *rest: Any) -> None:
        # How much is kept depends on the training clouds: the buffers take the sizes of what is loaded.
        for name in self._sized:
            if prefix + name in state_dict:
                setattr(self, name, torch.empty_like(state_dict[prefix + name]))
        super()._load_from_state_dict(state_dict, prefix, *rest)
