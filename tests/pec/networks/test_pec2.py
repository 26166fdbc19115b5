"""PEC2 is smaller than PEC; initial weights scaled to the data let clouds differ, and training resumes with them."""

import pytest
import torch

from pec.networks.initialise import scale_initial_weights
from pec.networks.pec import PEC
from pec.networks.pec2 import PEC2
from pec.training import run_state
from pec.training.loop import train


def test_it_is_smaller_than_the_published_network():
    count = sum(parameter.numel() for parameter in PEC2(64, 10).parameters())
    assert count == 705_204 < sum(parameter.numel() for parameter in PEC(64, 10).parameters())
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


def test_size_is_judged_apart_from_shape():
    """Ten times as large: another size, the same shape; the two judgements add up."""
    torch.manual_seed(0)
    model, points = PEC2(64, 10), 0.1 * torch.randn(50, 64, 3)
    for _ in range(20):
        model(points * torch.exp(torch.randn(50, 1, 3)))  # extents to normalise by
    model.eval()
    for layer in (model.head[1], model.size[-1]):  # one judgement falls silent
        kept = [parameter.clone() for parameter in layer.parameters()]
        for parameter in layer.parameters():
            parameter.data.zero_()
        alone, larger = model(points), model(10 * points)
        if layer is model.head[1]:
            by_size = alone
            assert not torch.allclose(alone, larger, atol=0.01)
        else:
            by_shape = alone
            assert torch.allclose(alone, larger, atol=1e-4)
        for parameter, value in zip(layer.parameters(), kept, strict=True):
            parameter.data.copy_(value)
    assert torch.allclose(model(points), by_size + by_shape, atol=1e-5)


def test_in_training_each_cloud_is_answered_by_its_shape_or_by_its_size():
    torch.manual_seed(0)
    model, points = PEC2(64, 10), torch.randn(400, 64, 3)
    for parameter in (*model.size[-1].parameters(), *model.head[1].parameters()):
        parameter.data.zero_()
    model.size[-1].bias.data.fill_(1.0)
    answers = model.train()(points)
    assert set(answers.flatten().tolist()) == {0.0, 1.0}
    assert (answers == answers[:, :1]).all()
    assert 0.2 < answers[:, 0].mean() < 0.4


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


@pytest.mark.slow
def test_interrupted_run_with_scaled_weights_ends_in_the_same_weights(shapes, tmp_path, monkeypatch):
    settings = {
        "dataset": {"path": str(shapes)},
        "protocol": {"epochs": 4, "batch_size": 16, "initial_weights": "scaled"},
        "model": {"name": "pec2"},
        "preprocess": {"n_candidates": 128, "sampling": "random", "pose": "upright", "ordering": "anchors"},
        "augment": {"subset": 0.7, "jitter": 0.001},
        "progress": False,
    }
    whole = train(settings | {"output": str(tmp_path / "whole")})

    done = run_state.write_checkpoint

    def stop_after_two_epochs(directory, checkpoint, state=None):
        done(directory, checkpoint, state)
        if state is not None and checkpoint.epoch == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(run_state, "write_checkpoint", stop_after_two_epochs)
    with pytest.raises(KeyboardInterrupt):
        train(settings | {"output": str(tmp_path / "cut")})
    monkeypatch.undo()
    cut = train(settings | {"output": str(tmp_path / "cut")})
    for name in ("best", "last"):
        weights = [(tmp_path / run / name / "model.safetensors").read_bytes() for run in ("whole", "cut")]
        assert weights[0] == weights[1]
    assert cut["best"] == whole["best"]
