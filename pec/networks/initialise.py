"""Initial weights through which signals of a data set keep their size, layer by layer.

With torch's own, PEC's decoder, which has no batch norm, shrinks what passes through it until its sigmoid gives nearly
the same half for every cloud, and the head learns late and from little.
"""

from __future__ import annotations

import torch
from torch import nn

__all__ = ["scale_initial_weights"]

_LAYERS = (nn.Linear, nn.Conv1d, nn.ConvTranspose1d)


@torch.no_grad()
def scale_initial_weights(model: nn.Module, inputs: torch.Tensor, seed: int) -> None:
    """Give each dense and convolutional layer orthogonal weights, scaled so that its outputs for `inputs` (B, …) have
    mean 0 and standard deviation 1 over the batch.

    Source: Mishkin & Matas, "All you need is a good init", ICLR 2016, with the means taken out too. The statistics of
    batch norm are left as they are; layers must be registered in the order in which they run.
    """
    layers = [module for module in model.modules() if isinstance(module, _LAYERS)]
    was_training = model.training
    statistics = {name: tensor.clone() for name, tensor in model.named_buffers()}
    model.train()
    with torch.random.fork_rng(devices=[inputs.device] if inputs.device.type == "cuda" else []):
        torch.manual_seed(seed)
        for layer in layers:
            nn.init.orthogonal_(layer.weight)
            assert layer.bias is not None
            layer.bias.zero_()
            outputs = _outputs_of(layer, model, inputs)
            # Channels come last but in torch's own convolutions (PEC's read signals with the channels last).
            channels_last = outputs.transpose(1, 2) if type(layer) in (nn.Conv1d, nn.ConvTranspose1d) else outputs
            # Spread between clouds: what is equal for all of them says nothing.
            spread = outputs.std(dim=0).mean().clamp_min(1e-6)
            layer.weight.div_(spread)
            layer.bias.copy_(-channels_last.flatten(0, -2).mean(dim=0) / spread)
    for name, tensor in model.named_buffers():
        tensor.copy_(statistics[name])
    model.train(was_training)


def _outputs_of(layer: nn.Module, model: nn.Module, inputs: torch.Tensor) -> torch.Tensor:
    """What `layer` gives when `model` sees `inputs`."""
    seen: list[torch.Tensor] = []
    handle = layer.register_forward_hook(lambda _module, _inputs, output: seen.append(output))
    try:
        model(inputs)
    finally:
        handle.remove()
    return seen[0]
