"""PEC for prediction: the same function in seventeen matrix products, several times faster on a CPU than its layers.

Batch norm is folded into the convolutions, a dense layer that no activation parts from its successor becomes part of
it, the first convolution is one dense layer of all coordinates, and each further one a product for each output.
"""

from __future__ import annotations

import torch

from pec.networks.pec import PEC

__all__ = ["FusedPEC"]

_NORM_EPSILON = 1e-5  # torch's default, which PEC keeps


class FusedPEC:
    """Callable like the `PEC` it is made of: (B, n_points, 3) → (B, n_classes) logits; on its device, no gradients."""

    def __init__(self, model: PEC) -> None:
        state = {name: tensor.detach() for name, tensor in model.state_dict().items()}
        self._first = _dense_convolution(*_folded_convolution(state, "encoder.0", "encoder.1"))
        self._encoder = [_folded_convolution(state, f"encoder.{i}", f"encoder.{i + 1}") for i in (3, 6)]
        self._bottleneck = _dense(state, "encoder.10", length=3)
        # Dense, then a transposed convolution of a signal of length 1, with no activation between: one dense layer.
        weight, bias = state["decoder.2.weight"], state["decoder.2.bias"]
        expand = weight.permute(0, 2, 1).flatten(1)
        self._expand = (
            (state["decoder.0.weight"].T @ expand).contiguous(),
            state["decoder.0.bias"] @ expand + bias.repeat(weight.shape[2]),
        )
        # Output l takes input l - 1 through tap 1 and input l through tap 0.
        weight = state["decoder.4.weight"]
        self._second = (torch.cat([weight[..., 1], weight[..., 0]]).contiguous(), state["decoder.4.bias"])
        self._third = (state["decoder.6.weight"][..., 0].contiguous(), state["decoder.6.bias"])
        self._head = [
            (state["head.0.weight"][..., 0].T.contiguous(), state["head.0.bias"]),
            _dense(state, "head.3", length=3),
            _dense(state, "head.5", length=1),
            _dense(state, "head.7", length=1),
        ]

    def __call__(self, points: torch.Tensor) -> torch.Tensor:
        return self.embed(points)[0]

    @torch.no_grad()
    def embed(self, points: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, n_points, 3) → (B, n_classes) logits and what the last layer makes them of, (B, n_points / 2)."""
        batch = len(points)
        # (B, 3 · channels) throughout, a channel fastest, so that a product runs over the channels.
        x = _product(points.flatten(1), *self._first).relu_()
        for weight, bias in self._encoder:
            x = _convolved(x, weight, bias, x.shape[1] // 3).relu_()
        x = _product(x, *self._bottleneck)
        x = _product(x, *self._expand).relu_()
        x = _convolved(x, *self._second, x.shape[1] // 2).relu_()
        x = _product(x.view(3 * batch, -1), *self._third).sigmoid_()
        x = _product(x, *self._head[0]).relu_().view(batch, -1)
        x = _product(x, *self._head[1]).relu_()
        x = _product(x, *self._head[2]).relu_()
        return _product(x, *self._head[3]), x


def _product(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    return torch.addmm(bias, x, weight)


def _convolved(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, channels: int) -> torch.Tensor:
    """(B, length · channels) → (B, 3 · out): the middle output sees all of the signal, the others all but an end of it.

    weight (length · channels, out): of the middle output. Nothing is multiplied by the zeros beyond the ends.
    """
    out = weight.shape[1]
    y = x.new_empty(len(x), 3 * out)
    torch.addmm(bias, x[:, :-channels], weight[channels:], out=y[:, :out])
    torch.addmm(bias, x, weight, out=y[:, out : 2 * out])
    torch.addmm(bias, x[:, channels:], weight[:-channels], out=y[:, 2 * out :])
    return y


def _folded_convolution(
    state: dict[str, torch.Tensor], convolution: str, norm: str
) -> tuple[torch.Tensor, torch.Tensor]:
    """(3 · in, out) weight and bias of a convolution of width 3 followed by batch norm in evaluation."""
    scale = state[f"{norm}.weight"] / (state[f"{norm}.running_var"] + _NORM_EPSILON).sqrt()
    weight = state[f"{convolution}.weight"] * scale[:, None, None]
    bias = (state[f"{convolution}.bias"] - state[f"{norm}.running_mean"]) * scale + state[f"{norm}.bias"]
    return weight.permute(2, 1, 0).flatten(0, 1).contiguous(), bias


def _dense_convolution(weight: torch.Tensor, bias: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """(in · 3, 3 · out) weight and bias of a convolution of width 3 over a signal of length 3 as one dense layer.

    weight (3 · in, out). Input (in, 3) flattened, output (3, out) flattened.
    """
    taps = weight.unflatten(0, (3, -1))
    dense = weight.new_zeros(taps.shape[1], 3, 3, taps.shape[2])
    for output in range(3):
        for tap in range(3):
            if 0 <= output + tap - 1 < 3:
                dense[:, output + tap - 1, output] = taps[tap]
    return dense.flatten(2).flatten(0, 1), bias.repeat(3)


def _dense(state: dict[str, torch.Tensor], name: str, length: int) -> tuple[torch.Tensor, torch.Tensor]:
    """(in, out) weight and bias of a dense layer, for inputs flattened with the channels last instead of first."""
    weight = state[f"{name}.weight"].unflatten(1, (-1, length)).transpose(1, 2).flatten(1)
    return weight.T.contiguous(), state[f"{name}.bias"]
