"""What a network predicts of many clouds: log-probabilities, the mean over equally valid poses."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import nn

from pec.known.form_witness import FormWitness, form_numbers
from pec.networks.registry import fast_forward
from pec.preprocessing.preprocess import Preprocess

__all__ = ["among_known", "arrange_views", "average_views", "log_probabilities", "predict_log_probabilities"]

_BATCH = 512  # clouds at once: bounds memory, changes no result


def predict_log_probabilities(
    model: nn.Module,
    preprocess: Preprocess,
    candidates: torch.Tensor,
    valid: torch.Tensor,
    forms: FormWitness | None = None,
) -> torch.Tensor:
    """(B, n_classes) log-probabilities, untempered: the mean of the probabilities over the equally valid poses, to
    the power of the network's weight times those of the witness of forms where there is one."""
    forward = fast_forward(model)
    blocks = zip(candidates.split(_BATCH), valid.split(_BATCH), strict=True)
    said = torch.cat([_of_block(forward, _views(preprocess, *block)) for block in blocks])
    if forms is None:
        return said
    pairs = zip(candidates.cpu().numpy(), valid.cpu().numpy(), strict=True)
    beside = forms.log_probabilities(form_numbers([points[there] for points, there in pairs]))
    return (float(forms.network_weight[0]) * said + torch.from_numpy(beside).to(said)).log_softmax(dim=1)


def arrange_views(preprocess: Preprocess, candidates: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    """Inputs (B, V, n_points, 3), one a valid pose, for `log_probabilities`: for clouds that are evaluated often."""
    blocks = zip(candidates.split(_BATCH), valid.split(_BATCH), strict=True)
    return torch.cat([_views(preprocess, *block) for block in blocks])


def log_probabilities(model: nn.Module, inputs: torch.Tensor) -> torch.Tensor:
    """As `predict_log_probabilities`, of inputs that `arrange_views` made."""
    forward = fast_forward(model)
    return torch.cat([_of_block(forward, block) for block in inputs.split(_BATCH)])


def _views(preprocess: Preprocess, candidates: torch.Tensor, valid: torch.Tensor) -> torch.Tensor:
    n_views = preprocess.n_views
    view = torch.arange(n_views, device=candidates.device).repeat(len(candidates))
    copies = candidates.repeat_interleave(n_views, dim=0), valid.repeat_interleave(n_views, dim=0)
    return preprocess.arrange(*copies, view).unflatten(0, (len(candidates), n_views))


@torch.no_grad()
def _of_block(forward: Callable[[torch.Tensor], torch.Tensor], inputs: torch.Tensor) -> torch.Tensor:
    logits = forward(inputs.flatten(0, 1)).unflatten(0, inputs.shape[:2])
    return average_views(logits.transpose(0, 1))


def average_views(logits: torch.Tensor) -> torch.Tensor:
    """(V, B, C) logits → (B, C) log of the mean probability over the V views."""
    return torch.logsumexp(logits.log_softmax(dim=2), dim=0) - math.log(len(logits))


def among_known(log_probabilities: torch.Tensor, n_classes: int) -> torch.Tensor:
    """(B, n_classes) log-probabilities given that the cloud is of one of the first `n_classes`, the known ones."""
    return log_probabilities[:, :n_classes].log_softmax(dim=1)
