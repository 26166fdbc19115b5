"""PEC2 gives mirrored clouds one answer, from one choice of points; initial weights keep signals at their size."""

import pytest
import torch

from pec import training
from pec.config import read_config
from pec.errors import ConfigError
from pec.initialise import scale_initial_weights
from pec.network import PEC
from pec.ordering import mirrored_anchor_positions
from pec.pec2 import PEC2
from pec.preprocess import Preprocess

PREPROCESS = Preprocess(n_candidates=256, sampling="random", ordering="mirrored_anchors")


def _arranged(points: torch.Tensor) -> torch.Tensor:
    return PREPROCESS.arrange(points, torch.ones(points.shape[:2], dtype=torch.bool))


def _network() -> PEC2:
    torch.manual_seed(0)
    network = PEC2(64, 10)
    network(torch.randn(50, 64, 3))  # batch norm gets statistics other than 0 and 1
    return network.eval()


@pytest.mark.parametrize("signs", [(-1, 1, 1), (1, -1, 1), (-1, -1, 1)])
def test_mirrored_clouds_get_one_answer(signs):
    network, points = _network(), torch.randn(20, 256, 3)
    with torch.no_grad():
        answers = network(_arranged(points))
        assert torch.allclose(network(_arranged(points * torch.tensor(signs))), answers, atol=1e-5)
        assert not torch.allclose(network(_arranged(points * torch.tensor([1, 1, -1]))), answers, atol=1e-3)
        assert not torch.allclose(network(_arranged(points[..., [1, 0, 2]])), answers, atol=1e-3)


def test_parameters_stay_within_the_published_ones():
    count = sum(parameter.numel() for parameter in PEC2(64, 10).parameters())
    assert count == 404_410 < sum(parameter.numel() for parameter in PEC(64, 10).parameters())


def test_mirrored_anchors_are_their_own_image_in_each_axis():
    anchors = mirrored_anchor_positions(64)
    assert anchors.unique(dim=0).shape == (64, 3)
    for axis in range(3):
        image = anchors * (1 - 2 * torch.eye(3)[axis])
        assert torch.cdist(image, anchors).min(dim=1).values.max() == 0


def test_network_in_another_order_is_refused():
    settings = {"dataset": {"path": "x"}, "output": "y", "model": {"name": "pec2"}}
    with pytest.raises(ConfigError, match=r"takes points in preprocess\.ordering 'mirrored_anchors', got 'anchors'"):
        read_config(settings)


def test_scaled_weights_let_clouds_differ():
    torch.manual_seed(0)
    inputs = 0.05 * torch.randn(100, 64, 3)
    models = [PEC(64, 10), PEC(64, 10)]
    buffers = {name: tensor.clone() for name, tensor in models[0].named_buffers()}
    for model in models:
        scale_initial_weights(model, inputs, seed=0)
    assert all(tensor.equal(buffers[name]) for name, tensor in models[0].named_buffers())
    for one, other in zip(*(model.parameters() for model in models), strict=True):
        assert one.equal(other)
    outputs = models[0](inputs)
    assert outputs.std(dim=0).mean().item() == pytest.approx(1, abs=0.01)
    assert outputs.mean(dim=0).abs().max() < 1e-4
    assert PEC(64, 10)(inputs).std(dim=0).mean() < 0.02  # torch's own weights hardly tell clouds apart


def test_interrupted_run_with_scaled_weights_ends_in_the_same_weights(shapes, tmp_path, monkeypatch):
    settings = {
        "dataset": {"path": str(shapes)},
        "protocol": {"epochs": 4, "batch_size": 16, "initial_weights": "scaled"},
        "model": {"name": "pec2"},
        "preprocess": {"n_candidates": 128, "sampling": "random", "pose": "principal", "ordering": "mirrored_anchors"},
        "augment": {"subset": 0.7, "jitter": 0.001},
        "progress": False,
    }
    whole = training.train(settings | {"output": str(tmp_path / "whole")})

    done = training.write_checkpoint

    def stop_after_two_epochs(directory, checkpoint, state=None):
        done(directory, checkpoint, state)
        if state is not None and checkpoint.epoch == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(training, "write_checkpoint", stop_after_two_epochs)
    with pytest.raises(KeyboardInterrupt):
        training.train(settings | {"output": str(tmp_path / "cut")})
    monkeypatch.undo()
    cut = training.train(settings | {"output": str(tmp_path / "cut")})
    for name in ("best", "last"):
        weights = [(tmp_path / run / name / "model.safetensors").read_bytes() for run in ("whole", "cut")]
        assert weights[0] == weights[1]
    assert cut["best"] == whole["best"]
