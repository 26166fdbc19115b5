"""The classifiers by the names that `model=` takes, and anyone's own by a dotted name."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

import torch
from torch import nn

from pec.errors import ConfigError
from pec.networks.baselines import (
    DGCNN,
    CurveNet,
    Forest,
    GDANet,
    Memorising,
    NearestNeighbours,
    PointCNN,
    PointMLPElite,
    PointNet,
    PointNet2,
    SLNetS,
    VanillaPointNet,
)
from pec.networks.fold_batchnorm import fold
from pec.networks.pec import PEC
from pec.networks.pec2 import PEC2
from pec.networks.pec_inference import FusedPEC

__all__ = ["MODELS", "build_model", "check_model", "fast_embed", "fast_forward"]

MODELS: dict[str, Callable[[int, int], nn.Module]] = {
    "pec": PEC,
    "pec2": PEC2,
    "pointnet": PointNet,
    "pointnet_vanilla": VanillaPointNet,
    "pointnet2": PointNet2,
    "dgcnn": DGCNN,
    "pointmlp_elite": PointMLPElite,
    "pointcnn": PointCNN,
    "curvenet": CurveNet,
    "gdanet": GDANet,
    "slnet_s": SLNetS,
    "knn": NearestNeighbours,
    "forest": Forest,
}


def build_model(name: str, n_points: int, n_classes: int) -> nn.Module:
    """The classifier `name`, (B, n_points, 3) → (B, n_classes) logits, with fresh weights.

    name: of MODELS, or "module.Class" of an importable nn.Module that is made by Class(n_points, n_classes).
    Raises ConfigError where there is none.
    """
    return _constructor(name)(n_points, n_classes)


def check_model(name: str) -> None:
    """Raises ConfigError where `name` is no classifier, neither of MODELS nor "module.Class"."""
    _constructor(name)


def _constructor(name: str) -> Callable[[int, int], nn.Module]:
    if name in MODELS:
        return MODELS[name]
    module_name, _, class_name = name.rpartition(".")
    if not module_name:
        raise ConfigError(f"model.name must be one of {', '.join(MODELS)}, or module.Class of your own, got {name!r}")
    try:
        found = getattr(import_module(module_name), class_name, None)
    except ModuleNotFoundError as error:
        way_out = f"is the folder of {module_name.partition('.')[0]}.py on PYTHONPATH?"
        raise ConfigError(f"model.name {name!r} cannot be imported: {error}; {way_out}") from error
    # A name in a checkpoint may come from anyone: only a network's class is ever called.
    if not (isinstance(found, type) and issubclass(found, nn.Module)):
        raise ConfigError(f"model.name {name!r}: {module_name} has no subclass of torch.nn.Module of that name")
    return found


def fast_forward(model: nn.Module) -> Callable[[torch.Tensor], torch.Tensor]:
    """The same function in evaluation and without gradients, by the quickest means that there are for a CPU.

    Of the weights as they are now; on their device.
    """
    if isinstance(model, PEC):
        return FusedPEC(model)
    return fold(model) if isinstance(model, PEC2) else model.eval()


def fast_embed(model: nn.Module) -> Callable[[torch.Tensor], tuple[torch.Tensor, torch.Tensor]]:
    """As `fast_forward`: (B, n_points, 3) → (B, n_classes) logits and (B, F) features, those that the last dense layer
    reads. A network of one's own that has no such layer, or reads no vector a cloud there, gives its logits twice.
    """
    if isinstance(model, PEC):
        return FusedPEC(model).embed
    if isinstance(model, PEC2):
        return fold(_Embedding(model))
    model = model.eval()
    if isinstance(model, Memorising):
        return torch.no_grad()(model.embed)
    dense = [module for module in model.modules() if isinstance(module, nn.Linear)]

    @torch.no_grad()
    def embed(points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        read: list[torch.Tensor] = []
        handle = dense[-1].register_forward_pre_hook(lambda _module, inputs: read.append(inputs[0])) if dense else None
        try:
            logits = model(points)
        finally:
            if handle:
                handle.remove()
        vectors = bool(read) and read[-1].ndim == 2 and len(read[-1]) == len(points)
        return logits, read[-1] if vectors else logits

    return embed


class _Embedding(nn.Module):
    """A network whose answer is what its `embed` gives."""

    def __init__(self, network: PEC2) -> None:
        super().__init__()
        self.network = network

    def forward(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.network.embed(points)
