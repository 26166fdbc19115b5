"""The published network has the published size."""

from collections import OrderedDict

import pytest
import torch
from torch import nn

from pec import PEC
from pec.networks.pec_inference import FusedPEC


@pytest.mark.parametrize(
    ("n_points", "n_classes", "parameters"),
    [(64, 5, 890_501), (64, 10, 890_666), (128, 5, 3_554_565), (256, 5, 14_203_397)],
)
def test_parameter_count_is_the_published_one(n_points, n_classes, parameters):
    model = PEC(n_points, n_classes)
    assert sum(parameter.numel() for parameter in model.parameters()) == parameters
    assert model.eval()(torch.zeros(2, n_points, 3)).shape == (2, n_classes)


def test_parameters_of_each_layer_are_the_published_ones():
    counts = [
        sum(parameter.numel() for parameter in layer.parameters())
        for part in (PEC().encoder, PEC().decoder, PEC().head)
        for layer in part
    ]
    expected = [
        49_408,
        512,
        393_728,
        1_024,
        98_368,
        128,
        6_176,
        2_112,
        33_024,
        262_656,
        32_832,
        2_080,
        6_208,
        2_080,
        165,
    ]
    assert [count for count in counts if count] == expected


def published_layers(n, n_classes):
    """The network in torch's own layers, on signals (B, channels, length)."""
    relu, flatten = nn.ReLU, nn.Flatten
    encoder = [nn.Conv1d(n, 4 * n, 3, padding=1), nn.BatchNorm1d(4 * n), relu()]
    encoder += [nn.Conv1d(4 * n, 8 * n, 3, padding=1), nn.BatchNorm1d(8 * n), relu()]
    encoder += [nn.Conv1d(8 * n, n, 3, padding=1), nn.BatchNorm1d(n), relu(), flatten(), nn.Linear(3 * n, n // 2)]
    decoder = [nn.Linear(n // 2, n), nn.Unflatten(1, (n, 1)), nn.ConvTranspose1d(n, 4 * n, 2), relu()]
    decoder += [nn.ConvTranspose1d(4 * n, 8 * n, 2), relu(), nn.ConvTranspose1d(8 * n, n, 1), nn.Sigmoid()]
    head = [nn.Conv1d(n, n // 2, 1), relu(), flatten(), nn.Linear(3 * n // 2, n), relu()]
    head += [nn.Linear(n, n // 2), relu(), nn.Linear(n // 2, n_classes)]
    parts = {"encoder": encoder, "decoder": decoder, "head": head}
    return nn.Sequential(OrderedDict((name, nn.Sequential(*layers)) for name, layers in parts.items()))


def test_outputs_and_gradients_are_those_of_torchs_convolutions():
    torch.manual_seed(0)
    model = PEC(16, 5).double()
    reference = published_layers(16, 5).double()
    reference.load_state_dict(model.state_dict())
    points = torch.randn(20, 16, 3, dtype=torch.float64)
    for training in (True, False):
        outputs = model.train(training)(points), reference.train(training)(points)
        assert torch.allclose(*outputs, rtol=0, atol=1e-12)
        for output in outputs:
            output.square().sum().backward()
        for (name, ours), theirs in zip(model.named_parameters(), reference.parameters(), strict=True):
            assert torch.allclose(ours.grad, theirs.grad, rtol=1e-9, atol=1e-12), name


def test_order_of_the_points_matters():
    torch.manual_seed(0)
    model, points = PEC().eval(), torch.randn(1, 64, 3)
    assert not torch.allclose(model(points), model(points.flip(1)))


@pytest.mark.parametrize(("n_points", "n_classes", "batch"), [(64, 5, 1), (64, 10, 4), (128, 3, 2)])
def test_fused_network_is_the_same_function(n_points, n_classes, batch):
    torch.manual_seed(0)
    model = PEC(n_points, n_classes)
    model(torch.randn(50, n_points, 3) * 2 + 1)  # batch norm gets statistics other than 0 and 1
    points = torch.randn(batch, n_points, 3)
    with torch.no_grad():
        assert torch.allclose(FusedPEC(model.eval())(points), model(points), atol=1e-6)
        for layer in model.head:
            if isinstance(layer, torch.nn.Linear):
                layer.weight *= 3  # untrained, the network hardly looks at its input: make it
        assert torch.allclose(FusedPEC(model)(points), model(points), atol=1e-5)
