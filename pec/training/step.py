"""One step of an optimiser, as all trainings here take it."""

from __future__ import annotations

import math

import torch

from pec.errors import TrainingError

__all__ = ["take_step"]


def take_step(optimizer: torch.optim.Optimizer, loss: torch.Tensor, rate: float, epoch: int) -> float:
    """Go down a loss at a learning rate, in the `epoch`-th pass, from 0; returns the loss.

    Raises TrainingError where it is not finite; nothing has changed then.
    """
    value = loss.item()
    if not math.isfinite(value):
        raise TrainingError(f"the loss is {value} in epoch {epoch + 1}: learning rate {rate:g} is too high")
    for group in optimizer.param_groups:
        group["lr"] = rate
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    optimizer.step()
    return value
