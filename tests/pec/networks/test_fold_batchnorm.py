"""Folded networks are the same function, whatever layers they are made of."""

import pytest
import torch
from torch import nn

from pec.networks.fold_batchnorm import fold
from pec.networks.pec2 import PEC2
from pec.networks.registry import fast_forward


def _with_statistics(model: nn.Module, inputs: torch.Tensor) -> nn.Module:
    """In evaluation, with norms whose statistics, weights and biases are not 0 and 1."""
    for layer in model.modules():
        if isinstance(layer, nn.BatchNorm1d):
            if layer.affine:
                nn.init.uniform_(layer.weight, 0.5, 2)
                nn.init.normal_(layer.bias)
            layer.momentum = None
    for _ in range(3):
        model.train()(inputs)
    return model.eval()


@pytest.mark.parametrize(("n_points", "n_classes", "batch"), [(64, 10, 1), (64, 5, 4), (128, 3, 7)])
def test_pec2_is_the_same_function(n_points, n_classes, batch):
    torch.manual_seed(0)
    model = _with_statistics(PEC2(n_points, n_classes), torch.randn(200, n_points, 3))
    points = torch.randn(batch, n_points, 3)
    logits = fast_forward(model)(points)
    with torch.no_grad():
        assert model(points).std() > 0.1
        assert torch.allclose(logits, model(points), atol=1e-5)
    assert not logits.requires_grad


class _Mixed(nn.Module):
    """Layers that fold and layers that do not: per point, normalised after use, activated twice, shared."""

    def __init__(self) -> None:
        super().__init__()
        self.points = nn.Linear(3, 8)
        self.first = nn.Sequential(nn.Flatten(), nn.Linear(128, 32, bias=False), nn.BatchNorm1d(32), nn.GELU())
        self.shared = nn.Linear(32, 32)
        self.norm, self.norm_of_shared = nn.BatchNorm1d(32), nn.BatchNorm1d(32)
        self.second = nn.Linear(32, 32)
        self.alone = nn.BatchNorm1d(32)
        self.last = nn.Sequential(nn.LayerNorm(32), nn.Dropout(0.5), nn.Identity(), nn.ReLU(), nn.Linear(32, 4))

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        x = self.first(self.points(points))
        y = self.second(x)
        shared = self.norm_of_shared(self.shared(x)) * self.shared(x + 1)
        return self.last(x + y * self.norm(y) + self.alone(x) + shared)


def test_layers_that_do_not_fold_stay_as_they_are():
    torch.manual_seed(0)
    model = _with_statistics(_Mixed(), torch.randn(200, 16, 3))
    points = torch.randn(5, 16, 3)
    with torch.no_grad():
        assert torch.allclose(fold(model)(points), model(points), atol=1e-5)


class _Branching(nn.Module):
    def forward(self, points: torch.Tensor) -> torch.Tensor:
        return points.sum(dim=(1, 2)) if points.sum() > 0 else -points.sum(dim=(1, 2))


def test_network_that_cannot_be_traced_comes_back_as_it_is():
    model = _Branching()
    for points in (torch.ones(1, 2, 3), -torch.ones(1, 2, 3)):
        assert fold(model)(points).tolist() == [6.0]
