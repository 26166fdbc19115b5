"""Batch norm's running statistics without what they start as.

torch lets them start at mean 0 and variance 1 and moves them a tenth of the way with each batch. Coordinates in metres
have variances of a thousandth: after 60 steps a first layer still divides by 17 times too much, and a network that is
right in training answers every cloud alike. A run on up to 128 clouds has no more steps than that.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from torch import nn
from torch.nn.modules.batchnorm import _BatchNorm

__all__ = ["without_their_start"]


@contextmanager
def without_their_start(model: nn.Module) -> Iterator[None]:
    """Inside, what `model` sees in training counts in its running statistics, and what they started as does not.

    The first batch gives them, the t-th moves them by m / (1 - (1 - m)^t) instead of by the momentum m: the correction
    of Adam's averages (Kingma & Ba, ICLR 2015), and after some fifty batches no other than torch's. The weights and
    the count of batches, which a checkpoint holds, are not touched: an interrupted run goes on as it would have.
    """
    norms = [module for module in model.modules() if isinstance(module, _BatchNorm)]
    momenta = [norm.momentum for norm in norms]
    hooks = [
        norm.register_forward_pre_hook(partial(_weigh, momentum))
        for norm, momentum in zip(norms, momenta, strict=True)
        if momentum  # None: all batches count alike
    ]
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()
        for norm, momentum in zip(norms, momenta, strict=True):
            norm.momentum = momentum


def _weigh(momentum: float, norm: _BatchNorm, _inputs: Any) -> None:
    if norm.training and norm.num_batches_tracked is not None:
        norm.momentum = momentum / (1 - (1 - momentum) ** (int(norm.num_batches_tracked) + 1))
