"""Networks that give every point a class: what their papers say of them, and that a class belongs to its point."""

import pytest
import torch
from torch import nn

from pec.errors import ConfigError
from pec.networks.baselines.neighbourhoods import nearest, squared_distances, take
from pec.networks.baselines.pointnet2_segmentation import PointNet2Segmentation, interpolated
from pec.networks.baselines.pointnet_segmentation import PointNetSegmentation
from pec.networks.pec import PEC
from pec.networks.pec_segmentation import PECSegmentation, published_order
from pec.networks.segmentation import SEGMENTATION
from pec.preprocessing.preprocess import farthest_point_sampling

N = 256


def clouds(batch: int, n: int = N, seed: int = 0) -> torch.Tensor:
    return 0.1 * torch.randn(batch, n, 3, generator=torch.Generator().manual_seed(seed))


def fresh(name: str, n_classes: int = 6) -> nn.Module:
    """Fresh weights, but statistics of such clouds."""
    torch.manual_seed(0)
    network = SEGMENTATION[name](64 if name == "pec_whole" else N, n_classes)
    for layer in network.modules():
        if isinstance(layer, nn.BatchNorm1d):
            layer.momentum = 1.0
    network.train()(clouds(4, 64 if name == "pec_whole" else N, 1))
    return network.eval()


@pytest.mark.parametrize("name", SEGMENTATION)
@pytest.mark.parametrize("n_classes", [3, 6])
def test_a_class_belongs_to_its_point_in_whatever_order_the_points_come(name, n_classes):
    network = fresh(name, n_classes)
    points = clouds(2, 64 if name == "pec_whole" else N, 2)
    order = torch.randperm(points.shape[1], generator=torch.Generator().manual_seed(3))
    with torch.no_grad():
        logits, permuted = network(points), network(points[:, order])
    assert logits.shape == (2, points.shape[1], n_classes)
    torch.testing.assert_close(permuted, logits[:, order], atol=1e-4, rtol=1e-4)
    assert logits.std(dim=1).min() > 0  # points differ


@pytest.mark.parametrize("name", [name for name in SEGMENTATION if name != "pec_whole"])
def test_other_numbers_of_points_are_taken(name):
    assert fresh(name)(clouds(1, 2 * N)).shape == (1, 2 * N, 6)


def test_a_class_of_a_table_moved_along_it_is_the_same():
    network, points = fresh("pec"), clouds(1, seed=4)
    with torch.no_grad():
        torch.testing.assert_close(network(points + torch.tensor([0.5, -0.2, 0])), network(points), atol=1e-3, rtol=0)


def test_pecs_encoder_is_the_published_one_and_its_decoder_torchs_transposed_convolutions():
    network = PECSegmentation(N, 5)
    published = {name: tensor.shape for name, tensor in PEC(64).encoder.state_dict().items()}
    assert {name: tensor.shape for name, tensor in network.encoder.state_dict().items()} == published
    code = torch.randn(3, network.decoder[0].in_features)
    signal = network.decoder[:2](code).transpose(1, 2)  # as torch has it, the channels first
    for layer in network.decoder[2:]:
        signal = nn.ConvTranspose1d.forward(layer, signal) if isinstance(layer, nn.ConvTranspose1d) else layer(signal)
    assert signal.shape == (3, 64, 5)  # a channel a point, a place a class
    torch.testing.assert_close(network.eval().decoder(code).transpose(1, 2), signal, atol=1e-5, rtol=1e-5)


def test_read_as_one_pec_has_the_published_bottleneck_and_nothing_beside_it():
    network = SEGMENTATION["pec_whole"](128, 6)
    assert network.context is None
    assert (network.encoder[-1].out_features, network.decoder[0].in_features) == (64, 64)


def test_published_order_is_farthest_points_in_the_published_groups():
    points = clouds(1, 64, 5)
    points -= points.mean(dim=1, keepdim=True)
    order = published_order(points, 16)[0]
    assert order.sort().values.tolist() == list(range(64))
    first = int(points[0].square().sum(dim=1).argmax())
    assert first in order.tolist()[::16]  # a group begins with the first of the sampling
    assert int(farthest_point_sampling(points[0].numpy(), 2, first)[1]) in order.tolist()[::16]
    centroids = points[0, order].view(4, 16, 3).mean(dim=1).square().sum(dim=1)
    assert (centroids.diff() >= 0).all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"n_classes": 2}, "n_classes=2 is too few"),
        ({"n_points": 1000}, "n_points=1000 must be a multiple of patch=64"),
        ({"patch": 8}, "patch=8, and that of 16"),
    ],
)
def test_what_pec_cannot_be_is_said(settings, message):
    with pytest.raises(ConfigError, match=message):
        PECSegmentation(**settings)


def test_parameters_are_the_published_ones():
    count = {
        name: sum(p.numel() for p in SEGMENTATION[name](1024, 13).parameters()) for name in ("pointnet", "pointnet2")
    }
    assert round(count["pointnet2"] / 1e6, 1) == 1.0  # as PointNeXt counts it for 13 classes, table 2
    # Figure 2: the classification form's trunk, then mlp(512, 256, 128) and mlp(128, 13) on 1,088 numbers of a point.
    head = (1088 + 1 + 2) * 512 + (512 + 1 + 2) * 256 + (256 + 1 + 2) * 128 + (128 + 1 + 2) * 128 + 129 * 13
    trunk = sum(p.numel() for name, p in PointNetSegmentation().named_parameters() if name.split(".")[0] in TRUNK)
    assert count["pointnet"] == trunk + head


TRUNK = ("input_transform", "low", "feature_transform", "high")


def test_pointnets_two_products_are_that_of_the_concatenation():
    network, points = fresh("pointnet"), clouds(2, seed=6)
    assert isinstance(network, PointNetSegmentation)
    with torch.no_grad():
        point, cloud = network.features(points)
        both = torch.cat([point, cloud[:, None].expand(-1, N, -1)], dim=2)
        weight = torch.cat([network.of_point.weight, network.of_cloud.weight], dim=1)
        x = torch.relu(network.norm((both @ weight.T + network.of_point.bias).flatten(0, 1))).view(2, N, 512)
        torch.testing.assert_close(network.point(x), network(points), atol=1e-4, rtol=1e-4)


def test_features_come_from_the_three_nearest_by_the_inverse_of_their_distance():
    coarse = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]]])
    features = torch.tensor([[[1.0], [2.0], [6.0], [100.0]]])
    fine = torch.tensor([[[0.0, 0, 0], [0.5, 0.5, 0], [0.25, 0, 0]]])
    x = interpolated(fine, coarse, features)[0, :, 0]
    assert x[0] == pytest.approx(1.0, abs=1e-4)  # where a coarse point lies, its own
    assert x[1] == pytest.approx(3.0, abs=1e-4)  # all three equally far
    weights = torch.tensor([1 / 0.25, 1 / 0.75, 1 / 1.0625**0.5])
    assert x[2] == pytest.approx(float((weights @ torch.tensor([1.0, 2, 6])) / weights.sum()), abs=1e-4)


def test_pointnet2_looks_no_farther_than_its_balls_reach():
    """A point that the farthest of its levels does not see changes nothing: two tables 10 m apart are two."""
    network = fresh("pointnet2")
    assert isinstance(network, PointNet2Segmentation)
    near, far = clouds(1, seed=7), clouds(1, seed=8) + 10
    other = clouds(1, seed=9) + 10
    with torch.no_grad():
        one, two = (network(torch.cat([near, rest], dim=1))[:, :N] for rest in (far, other))
    assert (one - two).abs().median() < 0.1 * one.std()


def test_distances_are_as_exact_in_training_with_bfloat16():
    """Products of bfloat16 would be off by more than the squared distance between neighbours."""
    points = clouds(2, 64)
    exact = squared_distances(points, points)
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(squared_distances(points, points), exact)
        assert torch.equal(nearest(points, points, 1)[1][..., 0], torch.arange(64).expand(2, -1))


def test_rows_are_taken_as_by_two_indices():
    features, index = torch.randn(3, 10, 4, requires_grad=True), torch.randint(0, 10, (3, 5, 2))
    taken = take(features, index)
    assert torch.equal(taken, features[torch.arange(3)[:, None, None], index])
    weights = torch.randn_like(taken)
    (grad,) = torch.autograd.grad((taken * weights).sum(), features)
    (reference,) = torch.autograd.grad((features[torch.arange(3)[:, None, None], index] * weights).sum(), features)
    torch.testing.assert_close(grad, reference)
