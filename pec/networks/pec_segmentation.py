"""PEC for semantic segmentation: the published encoder, and transposed convolutions back to a class for every point.

The dissertation leaves this open ("tested if its architecture could be used for semantic segmentation"), so all but the
encoder and the first two transposed convolutions is ours. x, y, z is a signal of length 3 and point i is channel i in
the encoder; in the decoder point i is channel i again and the signal's places are the classes: the last transposed
convolution makes a signal as long as there are classes of one of length 3. So features find back to their points by the
channel, and the order is undone at the end: the rows of the output belong to the rows of the input.

PEC's parameters grow with the square of the points: read as one, 1,024 points take 250 million of them (`patch` =
`n_points`, "pec_whole") and 4,096 take 4.0 billion. So by default a cloud is read in patches of 64 points by one
published encoder of 64 points, and the decoder is told beside a patch's code where the patch lies and what there is in
all patches. Patches are the groups of the published order, with 64 instead of 16 in a group; inside of a patch its
points are centred and in the published order, groups of 16 of farthest points.
"""

from __future__ import annotations

import torch
from torch import nn

from pec.errors import ConfigError
from pec.networks.baselines.layers import shared_mlp
from pec.networks.baselines.neighbourhoods import farthest_points, take
from pec.networks.pec import PEC, ConvTranspose1d
from pec.preprocessing.ordering import group_order

__all__ = ["PECSegmentation"]

_GROUP = 16  # points of a group of the published order


class PECSegmentation(nn.Module):
    """PEC for clouds of `n_points` points, or any multiple of `patch` where that is less, and three classes or more.

    Raises ConfigError where `patch` does not divide `n_points` or is no multiple of 16, or for fewer classes.
    """

    def __init__(self, n_points: int = 1024, n_classes: int = 6, patch: int = 64) -> None:
        super().__init__()
        if n_classes < 3:
            raise ConfigError(f"PEC's decoder makes a signal of three places or more: n_classes={n_classes} is too few")
        if n_points % patch or patch % _GROUP:
            raise ConfigError(f"n_points={n_points} must be a multiple of patch={patch}, and that of {_GROUP}")
        p, beside = patch, 0
        self.patch = patch
        self.encoder = PEC(p, n_classes).encoder
        self.context: nn.Module | None = None
        if patch < n_points:
            self.context = shared_mlp(p // 2 + 3, 4 * p)
            beside = 3 + 4 * p
        self.decoder = nn.Sequential(
            nn.Linear(p // 2 + beside, p),
            nn.Unflatten(1, (1, p)),
            ConvTranspose1d(p, 4 * p, 2),
            nn.ReLU(),
            ConvTranspose1d(4 * p, 8 * p, 2),
            nn.ReLU(),
            ConvTranspose1d(8 * p, p, n_classes - 2),
        )

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """(B, N, 3) points in any order, m → (B, N, n_classes) logits; N is n_points, or any multiple of `patch`."""
        points = points - points.mean(dim=1, keepdim=True)
        order = published_order(points, self.patch)
        patches = take(points, order).unflatten(1, (-1, self.patch))
        centres = patches.mean(dim=2)
        within = (patches - centres[:, :, None]).flatten(0, 1)
        inner = published_order(within, _GROUP)
        code = self.encoder(take(within, inner).transpose(1, 2))
        if self.context is not None:
            code = code.unflatten(0, centres.shape[:2])
            placed = torch.cat([code, centres], dim=2)
            context = self.context(placed).amax(dim=1, keepdim=True).expand(-1, centres.shape[1], -1)
            code = torch.cat([placed, context], dim=2).flatten(0, 1)
        logits = self.decoder(code).transpose(1, 2)
        logits = take(logits, inner.argsort(dim=1)).view(*points.shape[:2], -1)
        return take(logits, order.argsort(dim=1))


def published_order(points: torch.Tensor, group_size: int) -> torch.Tensor:
    """Indices (B, n) into `points` (B, n, 3): farthest points first, then the published grouping of those.

    The first point is the one farthest from the centroid, where the published sampling draws one by chance.
    """
    sampled = farthest_points(points, points.shape[1])
    return sampled.gather(1, group_order(take(points, sampled), group_size))
