"""Products in place of convolutions: values and gradients are those of torch's own layers, in both precisions."""

import pytest
import torch
from torch.nn import functional

from pec.networks.short_convolution import convolve


@pytest.mark.parametrize(("length", "taps"), [(3, 3), (2, 3), (1, 3), (5, 3), (4, 5)])
def test_it_is_a_convolution_with_zeros_around(length, taps):
    generator = torch.Generator().manual_seed(0)
    x = torch.randn(4, length, 6, generator=generator, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(5, 6, taps, generator=generator, dtype=torch.float64, requires_grad=True)
    bias = torch.randn(5, generator=generator, dtype=torch.float64, requires_grad=True)
    ours = convolve(x, weight.transpose(1, 2), bias, length, before=taps // 2)
    torchs = functional.conv1d(x.transpose(1, 2), weight, bias, padding=taps // 2).transpose(1, 2)
    _assert_equal(ours, torchs, (x, weight, bias), generator)


@pytest.mark.parametrize(("length", "taps"), [(1, 2), (2, 2), (3, 2), (2, 4)])
def test_it_is_a_transposed_convolution_with_the_taps_reversed(length, taps):
    generator = torch.Generator().manual_seed(1)
    x = torch.randn(4, length, 6, generator=generator, dtype=torch.float64, requires_grad=True)
    weight = torch.randn(6, 5, taps, generator=generator, dtype=torch.float64, requires_grad=True)
    bias = torch.randn(5, generator=generator, dtype=torch.float64, requires_grad=True)
    ours = convolve(x, weight.permute(1, 2, 0).flip(1), bias, length + taps - 1, before=taps - 1)
    torchs = functional.conv_transpose1d(x.transpose(1, 2), weight, bias).transpose(1, 2)
    _assert_equal(ours, torchs, (x, weight, bias), generator)


def test_clouds_that_want_no_gradient_get_none_and_the_weights_do():
    x, weight, bias = torch.randn(2, 3, 4), torch.randn(5, 3, 4, requires_grad=True), torch.zeros(5)
    convolve(x, weight, bias, 3, before=1).sum().backward()
    assert x.grad is None
    # Summed over outputs, the middle tap meets every value, the outer ones all but the last and the first.
    expected = torch.stack([x[:, :2].sum(dim=(0, 1)), x.sum(dim=(0, 1)), x[:, 1:].sum(dim=(0, 1))])
    torch.testing.assert_close(weight.grad, expected.expand(5, 3, 4))


def test_under_autocast_it_multiplies_in_bfloat16_and_gradients_keep_the_weights_precision():
    generator = torch.Generator().manual_seed(2)
    x = torch.randn(8, 3, 6, generator=generator, requires_grad=True)
    weight = torch.randn(5, 3, 6, generator=generator, requires_grad=True)
    bias = torch.randn(5, generator=generator, requires_grad=True)
    exact = convolve(x, weight, bias, 3, before=1)
    with torch.autocast("cpu", torch.bfloat16):
        y = convolve(x, weight, bias, 3, before=1)
    assert y.dtype == torch.bfloat16
    torch.testing.assert_close(y.float(), exact, rtol=0.02, atol=0.1)
    y.float().square().sum().backward()
    assert {tensor.grad.dtype for tensor in (x, weight, bias)} == {torch.float32}


def _assert_equal(ours, torchs, inputs, generator):
    torch.testing.assert_close(ours, torchs)
    towards = torch.randn(ours.shape, generator=generator, dtype=ours.dtype)
    for one, other in zip(
        torch.autograd.grad(ours, inputs, towards), torch.autograd.grad(torchs, inputs, towards), strict=True
    ):
        torch.testing.assert_close(one, other)
