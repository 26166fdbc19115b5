"""PEC2 is smaller than PEC; initial weights scaled to the data let clouds differ, and training resumes with them."""

import pytest
import torch

from pec import training
from pec.initialise import scale_initial_weights
from pec.network import PEC
from pec.pec2 import PEC2


def test_it_is_smaller_than_the_published_network():
    count = sum(parameter.numel() for parameter in PEC2(64, 10).parameters())
    assert count == 700_138 < sum(parameter.numel() for parameter in PEC(64, 10).parameters())
    assert PEC2(128, 3).eval()(torch.zeros(2, 128, 3)).shape == (2, 3)


def test_part_of_it_forgets_the_order_and_part_does_not():
    torch.manual_seed(0)
    model, points = PEC2(64, 10).eval(), torch.randn(5, 64, 3)
    shuffled = points[:, torch.randperm(64)]
    features = [model.point(cloud.flatten(0, 1)).unflatten(0, (5, 64)) for cloud in (points, shuffled)]
    assert torch.allclose(features[0].amax(dim=1), features[1].amax(dim=1), atol=1e-6)
    assert not torch.allclose(model(points), model(shuffled), atol=1e-3)
    # One point elsewhere is seen by both parts, each alone.
    moved = points.clone()
    moved[:, 7] += 5
    for silent in (model.ordered[0], model.pooled[1]):
        weight = silent.weight.detach().clone()
        silent.weight.data.zero_()
        assert not torch.allclose(model(points), model(moved), atol=1e-3)
        silent.weight.data.copy_(weight)


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
        "preprocess": {"n_candidates": 128, "sampling": "random", "pose": "upright", "ordering": "anchors"},
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
