"""The networks that give every point of a cloud a class, by the names that `network=` takes."""

from __future__ import annotations

from collections.abc import Callable

from torch import nn

from pec.networks.baselines.pointnet2_segmentation import PointNet2Segmentation
from pec.networks.baselines.pointnet_segmentation import PointNetSegmentation
from pec.networks.pec_segmentation import PECSegmentation

__all__ = ["SEGMENTATION"]


def _pec_whole(n_points: int, n_classes: int) -> PECSegmentation:
    return PECSegmentation(n_points, n_classes, patch=n_points)


SEGMENTATION: dict[str, Callable[[int, int], nn.Module]] = {
    "pec": PECSegmentation,
    "pec_whole": _pec_whole,
    "pointnet": PointNetSegmentation,
    "pointnet2": PointNet2Segmentation,
}
"""name → (n_points, n_classes) → a network with fresh weights, (B, N, 3) → (B, N, n_classes) logits. All but pec_whole
take other numbers of points than `n_points`, too."""
