"""AdamW, and its moments by the names of their parameters, as checkpoints keep them."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import nn

__all__ = ["adam_moments", "adamw", "restore_adam_moments"]


def adamw(module: nn.Module, learning_rate: float, weight_decay: float, device: torch.device) -> torch.optim.AdamW:
    """For the parameters of a module that is on `device`."""
    fused = True if device.type == "cpu" else None  # one pass over each tensor instead of ten
    return torch.optim.AdamW(module.parameters(), lr=learning_rate, weight_decay=weight_decay, fused=fused)


def adam_moments(module: nn.Module, optimizer: torch.optim.Optimizer) -> dict[str, torch.Tensor]:
    """ "PARAMETER/KEY" → tensor on the CPU, of an Adam or AdamW that has stepped."""
    return {
        f"{name}/{key}": value.detach().cpu().contiguous()
        for name, parameter in module.named_parameters()
        for key, value in optimizer.state[parameter].items()
    }


def restore_adam_moments(
    module: nn.Module, optimizer: torch.optim.Optimizer, moments: Mapping[str, torch.Tensor]
) -> None:
    """Give an optimizer the moments that `adam_moments` read."""
    for name, parameter in module.named_parameters():
        optimizer.state[parameter] = {
            key: moments[f"{name}/{key}"].to(parameter.device if key != "step" else "cpu")
            for key in ("step", "exp_avg", "exp_avg_sq")
        }
