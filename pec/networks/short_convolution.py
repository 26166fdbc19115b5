"""Convolutions of signals hardly longer than their kernels, for training: products of matrices, nothing copied.

A signal of three values with all its channels lies in one row of memory, so the window that an output sees is a part of
that row, and a product reads it where it is. What the padding would add are zeros: it is not computed. On a CPU a step
of PEC on many clouds takes two thirds of the time that gathering the windows first takes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import torch
from torch.autograd.function import once_differentiable

__all__ = ["convolve"]


def convolve(x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, n_out: int, before: int) -> torch.Tensor:
    """(B, n_in, c_in) signals → (B, n_out, c_out): output o sees the inputs from o - before on, as many as taps.

    weight: (c_out, taps, c_in). bias: (c_out,). Inputs beyond either end are zero. Under autocast in its precision.
    """
    device = x.device.type
    if torch.is_autocast_enabled(device):
        x, weight, bias = (tensor.to(torch.get_autocast_dtype(device)) for tensor in (x, weight, bias))
    with torch.autocast(device, enabled=False):
        y: torch.Tensor = _Convolution.apply(x.contiguous(), weight.contiguous(), bias, n_out, before)
    return y


class _Convolution(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: torch.Tensor, weight: torch.Tensor, bias: torch.Tensor, n_out: int, before: int
    ) -> torch.Tensor:
        ctx.save_for_backward(x, weight)
        ctx.before = before
        rows, columns = x.flatten(1), weight.flatten(1)
        y = x.new_empty(len(x), n_out, len(weight))
        for o, seen, used in _windows(x.shape[1], n_out, weight.shape[1], before, x.shape[2]):
            torch.addmm(bias, rows[:, seen], columns[:, used].T, out=y[:, o])
        return y

    @staticmethod
    @once_differentiable
    def backward(
        ctx: Any, gradient: torch.Tensor
    ) -> tuple[torch.Tensor | None, torch.Tensor, torch.Tensor, None, None]:
        x, weight = ctx.saved_tensors
        c_out, taps, c_in = weight.shape
        gradient = gradient.contiguous()
        of_x = None
        if ctx.needs_input_grad[0]:
            # An input is seen through the last tap first: a convolution of the gradient with the taps reversed.
            reverse = weight.flip(1).transpose(0, 1).reshape(taps * c_out, c_in)
            rows, of_x = gradient.flatten(1), torch.empty_like(x)
            for i, seen, used in _windows(gradient.shape[1], x.shape[1], taps, taps - 1 - ctx.before, c_out):
                torch.mm(rows[:, seen], reverse[used], out=of_x[:, i])
        rows, of_weight = x.flatten(1), torch.zeros_like(weight)
        columns = of_weight.flatten(1)
        for o, seen, used in _windows(x.shape[1], gradient.shape[1], taps, ctx.before, c_in):
            columns[:, used].addmm_(gradient[:, o].T, rows[:, seen])
        return of_x, of_weight, gradient.flatten(0, 1).sum(dim=0), None, None


def _windows(n_in: int, n_out: int, taps: int, before: int, channels: int) -> Iterator[tuple[int, slice, slice]]:
    """Each output with the columns of a row (n_in · channels) that it sees, and those of the taps that it uses."""
    for o in range(n_out):
        start = o - before
        first, last = max(start, 0), min(start + taps, n_in)
        yield o, slice(first * channels, last * channels), slice((first - start) * channels, (last - start) * channels)
