"""The rivals are what their papers say, do not care for the order of the points, and train like PEC."""

import itertools
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from pec import Classifier
from pec.data.loading import load_dataset
from pec.errors import ConfigError
from pec.networks.baselines import Forest, Memorising, NearestNeighbours, PointNet
from pec.networks.baselines.forest import invariants
from pec.networks.baselines.gdanet import sharp_and_gentle
from pec.networks.baselines.knn import describe
from pec.networks.baselines.neighbourhoods import farthest_points, nearest, squared_distances, take
from pec.networks.registry import MODELS, build_model, fast_forward
from pec.training.loop import train

RIVALS = [name for name in MODELS if not name.startswith("pec")]
NETWORKS = [name for name in RIVALS if name not in ("knn", "forest")]


def _clouds(batch: int, n: int = 64, seed: int = 0) -> torch.Tensor:
    points = 0.05 * torch.randn(batch, n, 3, generator=torch.Generator().manual_seed(seed))
    return points - points.mean(dim=1, keepdim=True)


def _model(name: str, n_points: int = 64, n_classes: int = 5) -> torch.nn.Module:
    """Fresh weights, but statistics of such clouds: those of an untrained batch norm drown them."""
    torch.manual_seed(0)
    model = build_model(name, n_points, n_classes)
    clouds, labels = _clouds(40, n_points, 1), torch.arange(40) % n_classes
    if isinstance(model, Memorising):
        model.fit(clouds, labels)
    else:
        for layer in model.modules():
            if isinstance(layer, torch.nn.BatchNorm1d):
                layer.momentum = 1.0
        model.train()(clouds)
    return model.eval()


@pytest.mark.parametrize(
    ("name", "published_millions"),
    [
        ("pointnet", 3.5),  # PointNet, table 6
        ("pointnet_vanilla", 0.8),  # the same
        ("pointnet2", 1.5),  # as PointNeXt counts it, table 1
        ("dgcnn", 1.8),  # as PointMLP counts it, table 1
        ("pointmlp_elite", 0.7),  # 0.68 in its paper, 0.72 by its released configuration
        ("pointcnn", 0.6),  # its table of costs
        ("gdanet", 0.9),
        ("slnet_s", 0.1),
    ],
)
def test_parameters_at_forty_classes_are_the_published_ones(name, published_millions):
    n = sum(parameter.numel() for parameter in build_model(name, 1024, 40).parameters())
    assert round(n / 1e6, 1) == published_millions


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("pointnet2", 1_475_688),
        ("dgcnn", 1_809_576),
        ("pointmlp_elite", 716_232),
        ("pointcnn", 599_340),
        ("curvenet", 2_140_672),
        ("gdanet", 936_616),
        ("slnet_s", 140_992 - 504),  # factors and shifts whose product it drops
    ],
)
def test_parameters_at_forty_classes_are_those_of_the_released_networks(name, parameters):
    assert sum(parameter.numel() for parameter in build_model(name, 64, 40).parameters()) == parameters


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize(("n_points", "n_classes", "batch"), [(64, 5, 1), (64, 10, 3), (128, 2, 2), (256, 3, 2)])
def test_shapes(name, n_points, n_classes, batch):
    model = _model(name, n_points, n_classes)
    logits = fast_forward(model)(_clouds(batch, n_points))
    assert logits.shape == (batch, n_classes)
    assert torch.isfinite(logits).all()


@pytest.mark.parametrize("name", RIVALS)
def test_order_of_the_points_does_not_matter(name):
    model, points = _model(name), _clouds(4)
    shuffled = points[:, torch.randperm(64, generator=torch.Generator().manual_seed(2))]
    with torch.no_grad():
        logits = model(points)
        assert logits.std(dim=0).max() > 1e-4  # it tells the clouds apart at all
        assert torch.allclose(model(shuffled), logits, atol=1e-5)


@pytest.mark.parametrize("name", NETWORKS)
def test_every_parameter_and_every_point_gets_a_gradient(name):
    torch.manual_seed(0)
    model, points = build_model(name, 64, 5).train(), _clouds(32).requires_grad_()
    loss = torch.nn.functional.cross_entropy(model(points), torch.arange(32) % 5)
    if isinstance(model, PointNet):
        loss = loss + model.penalty
    loss.backward()
    without = [key for key, parameter in model.named_parameters() if not parameter.grad.any()]
    # Zero weights behind them at the start: the transforms begin as the identity, GDANet attends to nothing.
    begins = [key for key in without if "transform" in key and ".matrix" not in key]
    begins += [key for key in without if "attention" in key and ".norm" not in key]
    assert without == begins
    assert points.grad.any()


@pytest.mark.parametrize("name", ["pointcnn", "curvenet", "gdanet", "slnet_s"])
def test_ten_clouds_are_learnt_by_heart(name):
    torch.manual_seed(0)
    model, clouds, labels = build_model(name, 64, 5).train(), _clouds(10), torch.arange(10) % 5
    for layer in model.modules():
        if isinstance(layer, torch.nn.Dropout):
            layer.p = 0.0
    optimizer = torch.optim.Adam(model.parameters(), lr=0.005)
    for _ in range(15):
        optimizer.zero_grad()
        torch.nn.functional.cross_entropy(model(clouds), labels).backward()
        optimizer.step()
    assert (model(clouds).argmax(dim=1) == labels).all()


def test_transforms_begin_as_the_identity_and_cost_nothing_there():
    model = PointNet().train()
    model(_clouds(4))
    assert model.penalty.item() == 0
    with torch.no_grad():
        model.feature_transform.matrix.bias.mul_(2)
    model(_clouds(4))
    assert model.penalty.item() == pytest.approx(0.001 * 64 * 9)  # ‖I - 4 I‖² of size 64


def test_an_edge_convolution_is_its_definition():
    """A dense layer of each edge (x_j - x_i, x_i), batch norm, leaky ReLU, maximum over the neighbours."""
    edge = _model("dgcnn").edges[1]
    x = torch.randn(1, 30, 64, generator=torch.Generator().manual_seed(0))
    neighbours = torch.cdist(x, x).topk(10, dim=2, largest=False).indices[0]
    computed = edge(x)[0]
    for i in range(30):
        edges = torch.cat([x[0, neighbours[i]] - x[0, i], x[0, i].expand(10, -1)], dim=1)
        expected = torch.nn.functional.leaky_relu(edge.norm(edges @ edge.linear.weight.T), 0.2).amax(dim=0)
        assert torch.allclose(computed[i], expected, atol=1e-4)


def test_an_x_convolution_is_its_definition():
    """Algorithm 1: lifted neighbours beside their features, weighted by the matrix, convolved in their order."""
    layer = _model("pointcnn").layers[1]
    points, features = _clouds(1), torch.randn(1, 64, 48, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        computed = layer(points, features, 5)
        neighbours = torch.cdist(points, points).topk(24, dim=2, largest=False).indices[0, :, ::2]
        for i in range(5):
            local = points[0, neighbours[i]] - points[0, i]
            x = torch.cat([layer.lift(local), features[0, neighbours[i]]], dim=1)
            matrix = layer.matrix(local.flatten()[None])[0]
            for again, norm in zip(layer.matrix_again, layer.norms, strict=True):
                columns = [matrix[:, c] @ again.weight[c] for c in range(12)]
                matrix = norm(torch.stack(columns).flatten()[None]).view(12, 12)
            x = matrix @ x
            sums = [x[:, c] @ layer.each.weight[c] for c in range(x.shape[1])]
            assert torch.allclose(layer.join(torch.cat(sums)[None])[0], computed[0, i], atol=1e-4)


def test_curves_go_from_neighbour_to_neighbour_and_do_not_turn_straight_back():
    walk = _model("curvenet").blocks[0].walk
    x = torch.randn(2, 40, 16, generator=torch.Generator().manual_seed(0))
    neighbours = nearest(x, x, 11)[1][..., 1:]
    with torch.no_grad():
        curves = walk(x, neighbours)
        weighted = x * torch.sigmoid(walk.importance(x))
    assert curves.shape == (2, 4, 5, 16)
    distances, places = (curves[:, :, :, None] - weighted[:, None, None]).norm(dim=4).min(dim=3)
    assert distances.max() < 1e-5  # every step stands on a point
    for cloud, curve in zip(neighbours, places, strict=True):
        assert all(after in cloud[before] for steps in curve for before, after in itertools.pairwise(steps))
    last, steps = torch.tensor([[[1.0, 0.0]]]), torch.tensor([[[[2.0, 0.0], [0.0, 1.0], [-3.0, 0.0], [-1.0, 1.0]]]])
    assert walk._forward(last, steps).flatten().tolist() == pytest.approx([1, 1, 0, 1 - 0.5**0.5], abs=1e-6)


def test_sharp_points_are_those_unlike_their_surroundings():
    line = torch.linspace(0, 1, 40)[:, None] * torch.tensor([0.3, 0.0, 0.0])  # within reach of each other
    x = torch.cat([line - line.mean(dim=0), torch.tensor([[0.0, 9, 0], [0, 0, -9]])])[None]
    sharp, gentle = sharp_and_gentle(x)
    assert sharp.shape == gentle.shape == (1, 10, 3)
    assert sharp[0, :2].abs().amax(dim=1).tolist() == [9, 9]
    assert gentle.abs().max() < 0.1  # the middle of the line


def test_the_embedding_without_weights_is_its_definition():
    embed, points = _model("slnet_s").embed, torch.tensor([[[-5 / 7, 0.2, 1.0], [0.3, -0.1, 0.5]]])
    spread = points[0].std(dim=0).mean()
    places, width = (-1 + 2 * torch.arange(1, 7) / 7), 0.4 * (1 + spread)
    share = torch.sigmoid(10 * (spread - 0.1))
    offset = (points[0, 0, :, None] - places) / width
    every = (share * torch.exp(-(offset**2) / 2) + (1 - share) * torch.cos(offset)).flatten()
    kept = [i for i in range(18) if i not in (8, 16)]  # sixteen of eighteen, evenly
    assert embed(points)[0, 0].tolist() == pytest.approx(every[kept].tolist(), abs=1e-6)


def test_slnet_sees_shape_only():
    model, points = _model("slnet_s"), _clouds(3)
    with torch.no_grad():
        assert torch.allclose(model(7 * points), model(points), atol=1e-3)


def test_pointcnn_refuses_fewer_points_than_its_neighbourhoods_need():
    with pytest.raises(ConfigError, match="takes 64 points or more, got preprocess"):
        build_model("pointcnn", 32, 5)


def test_neighbourhoods_of_known_points():
    line = torch.tensor([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [10, 0, 0], [4, 0, 0]]])
    assert farthest_points(line, 4).tolist() == [[3, 0, 4, 2]]
    assert farthest_points(line, 2).tolist() == [[3, 0]]  # a prefix
    squared, indices = nearest(line[:, 1:2], line, 3)
    assert indices[0, 0].tolist() in ([1, 0, 2], [1, 2, 0])
    assert squared[0, 0].tolist() == [0, 1, 1]
    assert nearest(line, line, 9)[1].shape == (1, 5, 5)
    assert take(line, torch.tensor([[[4, 3]]]))[0, 0, :, 0].tolist() == [4, 10]
    points = _clouds(2)
    assert torch.allclose(squared_distances(points, points), torch.cdist(points, points).square(), atol=1e-7)


def test_descriptor_is_the_same_in_every_pose():
    points = _clouds(3)
    rotation = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0))).Q
    assert torch.allclose(describe(points @ rotation.T + 1), describe(points), atol=1e-5)
    assert torch.allclose(describe(2 * points), 2 * describe(points), atol=1e-5)


def test_nearest_neighbours_know_what_they_were_shown():
    model, clouds = NearestNeighbours(64, 3), _clouds(30)
    sizes = torch.arange(30) % 3
    clouds = clouds * (1 + sizes)[:, None, None]
    left_out = model.fit(clouds, sizes)
    assert (left_out.argmax(dim=1) == sizes).all()
    assert torch.allclose(left_out.exp().sum(dim=1), torch.ones(30))
    assert (model(_clouds(6, seed=5) * 3).argmax(dim=1) == 2).all()
    assert model(clouds[:1]).exp().max() < 1  # no number of votes is certainty


def test_the_forests_numbers_do_not_turn_with_a_cloud_and_hardly_change_with_a_few_points_more():
    points = _clouds(4, 128)
    rotation = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0))).Q
    assert invariants(points).shape == (4, 64)
    assert torch.allclose(invariants(points @ rotation.T + 0.3), invariants(points), atol=1e-4)
    assert torch.allclose(invariants(points[:, torch.randperm(128)]), invariants(points), atol=1e-5)
    plate = torch.rand(1, 128, 3) * torch.tensor([0.1, 0.06, 0.0])
    flat = invariants(plate)[0, 34:39]  # quantiles of how far the nearest points lie from their plane, m
    assert float(flat.max()) < 1e-4


def test_a_forest_knows_what_it_was_shown_and_tells_how_well_by_the_trees_that_were_not():
    model, clouds = Forest(64, 3), _clouds(60)
    sizes = torch.arange(60) % 3
    clouds = clouds * (1 + sizes)[:, None, None]
    left_out = model.fit(clouds, sizes)
    assert (left_out.argmax(dim=1) == sizes).float().mean() > 0.9
    assert torch.allclose(left_out.exp().sum(dim=1), torch.ones(60))
    assert (model(_clouds(6, seed=5) * 3).argmax(dim=1) == 2).all()
    again = Forest(64, 3)
    again.fit(clouds, sizes)
    assert torch.equal(again(clouds), model(clouds))
    kept = Forest(64, 3)
    kept.load_state_dict(model.state_dict())
    assert torch.equal(kept(clouds), model(clouds))


def _settings(shapes, output, name, **changes):
    protocol = {"epochs": 5, "batch_size": 16, "made_strangers": 0.0} | changes.pop("protocol", {})
    return {
        "dataset": {"path": str(shapes)},
        "preprocess": {"ordering": "none"},
        "augment": {"scale": 0.05},
        "model": {"name": name},
        "output": str(output),
        "protocol": protocol,
        "progress": False,
    } | changes


@pytest.mark.parametrize("name", ["pointnet_vanilla", "knn", "forest"])
def test_rival_learns_by_the_same_protocol_and_classifies_from_its_checkpoint(name, shapes, tmp_path):
    results = train(_settings(shapes, tmp_path, name, protocol={"epochs": 12, "batch_size": 8}))
    assert results["protocol"].startswith("honest")
    assert results["config"]["model"]["name"] == name
    assert results["last"]["epoch"] == (12 if name in NETWORKS else 1)
    assert results["best"]["test_accuracy"] > 0.6
    dataset = load_dataset(shapes)
    answers = Classifier.load(results["checkpoint"]).predict([dataset.cloud(i) for i in range(0, 120, 4)])
    right = [answer.label == dataset.classes[dataset.labels[4 * i]] for i, answer in enumerate(answers)]
    assert np.mean(right) > 0.6


@pytest.mark.parametrize(
    "name", ["pointnet", "pointnet2", "dgcnn", "pointmlp_elite", "pointcnn", "curvenet", "gdanet", "slnet_s"]
)
def test_every_network_goes_through_training_and_its_checkpoint(name, shapes, tmp_path):
    settings = _settings(shapes, tmp_path, name, protocol={"epochs": 1})
    results = train(settings | {"dataset": settings["dataset"] | {"samples_per_instance": 10}})
    assert results["parameters"] == sum(p.numel() for p in build_model(name, 64, 3).parameters())
    assert len(Classifier.load(results["checkpoint"]).predict(load_dataset(shapes).cloud(0)).probabilities) == 3


@pytest.mark.slow
def test_dropout_is_drawn_alike_after_a_kill(shapes, tmp_path):
    through = _settings(shapes, tmp_path / "through", "pointnet_vanilla")
    killed = _settings(shapes, tmp_path / "killed", "pointnet_vanilla")
    train(through)
    process = subprocess.Popen([sys.executable, "-c", f"from pec.training import train; train({killed!r})"])
    progress = tmp_path / "killed" / "last" / "training_state" / "progress.json"
    deadline = time.monotonic() + 60
    while not progress.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "killed" / "results.json").exists()
    torch.manual_seed(17)  # whatever was drawn before in this process
    train(killed)
    weights = [load_file(tmp_path / name / "last" / "model.safetensors") for name in ("through", "killed")]
    assert all(tensor.equal(weights[1][key]) for key, tensor in weights[0].items())
    curves = [
        json.loads((tmp_path / n / "last/training_state/progress.json").read_text()) for n in ("through", "killed")
    ]
    assert curves[0]["history"] == curves[1]["history"]
    assert len(curves[0]["history"]["train_loss"]) == 5
