"""PEC2: a classifier of 64 ordered points that gives mirrored clouds one answer.

The points come in the order of `mirrored_anchors`: fixed positions that are their own mirror image. So the mirrored
cloud's input is the same points with signs changed and in another, known order, and the network looks at all four
images (as it is, left and right exchanged, front and back exchanged, both) without choosing points again. One trunk
reads each image, the mean of what it found goes into the head.

At 64 points and 10 classes: 404,410 parameters, 1.1 million multiply-adds a cloud.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.ordering import mirrored_anchor_positions

__all__ = ["PEC2"]

_WIDTH = 400
_DROPOUT = 0.3


class PEC2(nn.Module):
    """PEC2 for clouds of `n_points` points, a multiple of 64, and `n_classes` classes."""

    mirrors: torch.Tensor
    order: torch.Tensor

    def __init__(self, n_points: int = 64, n_classes: int = 5) -> None:
        super().__init__()
        anchors = mirrored_anchor_positions(n_points)
        mirrors = torch.tensor([[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, -1.0, 1.0]])
        images = mirrors[:, None] * anchors
        # order[m, i]: the position whose image in mirror m is position i.
        order = torch.cdist(anchors.expand(4, -1, -1), images).argmin(dim=2)
        self.register_buffer("mirrors", mirrors, persistent=False)
        self.register_buffer("order", order, persistent=False)
        self.trunk = nn.Sequential(*_dense(3 * n_points, _WIDTH), *_dense(_WIDTH, _WIDTH))
        self.head = nn.Sequential(*_dense(_WIDTH, _WIDTH), nn.Linear(_WIDTH, n_classes))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, n_points, 3) centred points in the order of `mirrored_anchors` → (B, n_classes) logits."""
        images = points[:, self.order] * self.mirrors[:, None]
        return self.head(self.trunk(images.flatten(2).flatten(0, 1)).unflatten(0, (-1, 4)).mean(dim=1))


def _dense(n_in: int, n_out: int) -> list[nn.Module]:
    return [nn.Linear(n_in, n_out), nn.BatchNorm1d(n_out), nn.ReLU(), nn.Dropout(_DROPOUT)]
