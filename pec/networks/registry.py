"""The classifiers by the names that `model=` takes."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import nn

from pec.networks.baselines import DGCNN, NearestNeighbours, PointMLPElite, PointNet, PointNet2, VanillaPointNet
from pec.networks.fold_batchnorm import fold
from pec.networks.pec import PEC
from pec.networks.pec2 import PEC2
from pec.networks.pec_inference import FusedPEC

__all__ = ["MODELS", "build_model", "fast_forward"]

MODELS: dict[str, Callable[[int, int], nn.Module]] = {
    "pec": PEC,
    "pec2": PEC2,
    "pointnet": PointNet,
    "pointnet_vanilla": VanillaPointNet,
    "pointnet2": PointNet2,
    "dgcnn": DGCNN,
    "pointmlp_elite": PointMLPElite,
    "knn": NearestNeighbours,
}


def build_model(name: str, n_points: int, n_classes: int) -> nn.Module:
    """The classifier `name` of MODELS, (B, n_points, 3) → (B, n_classes) logits, with fresh weights."""
    return MODELS[name](n_points, n_classes)


def fast_forward(model: nn.Module) -> Callable[[torch.Tensor], torch.Tensor]:
    """The same function in evaluation and without gradients, by the quickest means that there are for a CPU.

    Of the weights as they are now; on their device.
    """
    if isinstance(model, PEC):
        return FusedPEC(model)
    return fold(model) if isinstance(model, PEC2) else model.eval()
