"""Training learns, keeps its protocols apart, and survives being killed."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from pec.checkpoint import read_checkpoint, read_training_state
from pec.common.threads import torch_threads
from pec.data.loading import load_dataset
from pec.errors import ConfigError, DatasetError, TrainingError
from pec.training.config import read_config
from pec.training.epoch import log_class_shares
from pec.training.loop import train
from pec.training.run_split import split


def _settings(shapes: Path, output: Path, **changes) -> dict:
    # One precision: that which is faster is measured, and a busy machine takes now the one and now the other.
    protocol = {"epochs": 15, "batch_size": 16, "made_strangers": 0.0, "precision": "float32"}
    protocol |= changes.pop("protocol", {})
    return {
        "dataset": {"path": str(shapes)},
        "output": str(output),
        "protocol": protocol,
        "augment": {"remove": 0.4, "jitter": 0.001},
        "progress": False,
    } | changes


@pytest.fixture(scope="module")
def run(shapes, tmp_path_factory):
    output = tmp_path_factory.mktemp("run")
    return output, train(_settings(shapes, output))


def test_it_learns_shapes_of_any_orientation(run):
    _, results = run
    assert results["best"]["test_accuracy"] > 0.9
    assert results["parameters"] == 890_501 - 2 * 33


def test_results_are_written_and_consistent(run):
    output, results = run
    assert json.loads((output / "results.json").read_text()) == results
    confusion = np.array(results["best"]["test_confusion"])
    assert confusion.sum() == results["n_samples"]["test"] == 30
    assert confusion.trace() / 30 == pytest.approx(results["best"]["test_accuracy"])
    assert results["last"]["epoch"] == 15
    sizes = {"train": 84, "selection": 6, "calibration": 6 + 6, "test": 30, "strangers_in_training": 0}
    assert results["n_samples"] == sizes
    assert list((output / "tensorboard").iterdir())


def test_confidence_is_not_driven_to_certainty_by_easy_clouds(run):
    # With every clean validation cloud right, a temperature fitted on those alone runs to its lower bound of 0.05.
    output, results = run
    for name in ("best", "last"):
        temperature = json.loads((output / name / "config.json").read_text())["temperature"]
        assert temperature == results[name]["temperature"]
        assert temperature > 0.06


def test_finished_run_is_not_repeated(run, shapes):
    output, results = run
    before = (output / "last" / "model.safetensors").stat().st_mtime_ns
    assert train(_settings(shapes, output)) == results
    assert (output / "last" / "model.safetensors").stat().st_mtime_ns == before


def test_output_of_other_settings_is_not_mixed(run, shapes):
    output, _ = run
    with pytest.raises(ConfigError, match=r"protocol\.learning_rate=0\.002, not 0\.1"):
        train(_settings(shapes, output, protocol={"learning_rate": 0.1}))


def test_run_knows_its_data_wherever_they_lie(run, shapes, tmp_path):
    output, results = run
    moved = shutil.copytree(shapes, tmp_path / "moved")
    assert train(_settings(moved, output)) == results
    manifest = json.loads((moved / "manifest.json").read_text())
    (moved / "manifest.json").write_text(json.dumps(manifest | {"seed": 5}))
    with pytest.raises(ConfigError, match=r"dataset\.path=.*, not .*moved"):
        train(_settings(moved, output))


def test_run_is_not_mixed_with_data_that_changed_in_their_place(shapes, tmp_path):
    data = shutil.copytree(shapes, tmp_path / "data")
    train(_settings(data, tmp_path / "out", protocol={"epochs": 1}))
    manifest = (data / "manifest.json").read_text()
    (data / "manifest.json").write_text(json.dumps(json.loads(manifest) | {"seed": 5}))
    with pytest.raises(ConfigError, match=r"other data: .*data has changed since"):
        train(_settings(data, tmp_path / "out", protocol={"epochs": 1}))
    shutil.rmtree(data)
    assert train(_settings(data, tmp_path / "out", protocol={"epochs": 1}))["epochs"] == 1  # done, its data deleted


def test_equal_seeds_give_equal_weights(run, shapes, tmp_path):
    output, _ = run
    train(_settings(shapes, tmp_path))
    _assert_equal_weights(output, tmp_path)


def test_killed_run_ends_in_the_same_weights(run, shapes, tmp_path):
    output, _ = run
    settings = _settings(shapes, tmp_path)
    code = f"from pec.training import train; train({settings!r})"
    process = subprocess.Popen([sys.executable, "-c", code])
    deadline = time.monotonic() + 60
    while _epochs_done(tmp_path) < 3 and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    done = _epochs_done(tmp_path)
    assert 3 <= done <= 15
    assert not (tmp_path / "results.json").exists()
    # It goes on where its data have moved, and not where they are others.
    moved = shutil.copytree(shapes, tmp_path / "moved")
    manifest = (moved / "manifest.json").read_text()
    (moved / "manifest.json").write_text(json.dumps(json.loads(manifest) | {"seed": 5}))
    with pytest.raises(ConfigError, match=r"dataset\.path=.*, not .*moved"):
        train(_settings(moved, tmp_path))
    (moved / "manifest.json").write_text(manifest)
    train(_settings(moved, tmp_path))
    _assert_equal_weights(output, tmp_path)


def test_replacement_killed_between_its_renames_is_undone(run, shapes, tmp_path):
    output, _ = run
    shutil.copytree(output / "last", tmp_path / "last.old.tmp")
    assert read_training_state(tmp_path / "last").progress["epoch"] == 15


def _epochs_done(output: Path) -> int:
    path = output / "last" / "training_state" / "progress.json"
    try:
        return json.loads(path.read_text())["epoch"]
    except (FileNotFoundError, NotADirectoryError):
        return 0


def _assert_equal_weights(one: Path, other: Path) -> None:
    for name in ("best", "last"):
        weights = [load_file(output / name / "model.safetensors") for output in (one, other)]
        assert weights[0].keys() == weights[1].keys()
        assert all(tensor.equal(weights[1][key]) for key, tensor in weights[0].items())


def test_published_protocol_is_full_batch_and_labelled(shapes, tmp_path):
    published = {"selection": "evaluation split", "batch_size": None, "schedule": "constant", "learning_rate": 0.01}
    published |= {"epochs": 3, "weight_decay": 0.0, "label_smoothing": 0.0}
    preprocess = {"ordering": "groups", "group_size": 16}
    results = train(_settings(shapes, tmp_path, protocol=published, preprocess=preprocess, augment={}))
    assert "optimistic" in results["protocol"]
    sizes = {"train": 90, "selection": 30, "calibration": 60, "test": 30, "strangers_in_training": 0}
    assert results["n_samples"] == sizes
    assert results["warnings"] == []  # the published protocol knows no unseen instances
    assert results["best"]["selection_accuracy"] == results["best"]["test_accuracy"]
    steps = [value for key, value in read_training_state(tmp_path / "last").optimizer.items() if key.endswith("step")]
    assert {int(step) for step in steps} == {3}


def test_products_of_half_precision_train_other_weights_that_are_kept_in_full(shapes, tmp_path):
    weights = []
    for precision in ("float32", "bfloat16"):
        protocol = {"epochs": 2, "precision": precision}
        results = train(_settings(shapes, tmp_path / precision, protocol=protocol))
        assert np.isfinite(results["curves"]["train_loss"]).all()
        weights.append(read_checkpoint(tmp_path / precision / "last").model.state_dict())
    assert {tensor.dtype for tensor in weights[1].values()} == {torch.float32, torch.int64}
    assert any(not torch.equal(a, b) for a, b in zip(*(state.values() for state in weights), strict=True))
    with pytest.raises(ConfigError, match=r"protocol\.precision must be one of auto, float32, bfloat16, got 'half'"):
        train(_settings(shapes, tmp_path / "x", protocol={"precision": "half"}))


def test_logit_adjustment_makes_up_for_unequal_classes(shapes, tmp_path):
    shares = log_class_shares(torch.tensor([0, 0, 0, 2]), 3)
    assert shares.exp().tolist() == pytest.approx([0.75, 0.125, 0.25])
    # What says nothing of the class is best answered by the shares; adjusted by all of them, by no class at all.
    logits = torch.zeros(3, requires_grad=True)
    for _ in range(200):
        loss = torch.nn.functional.cross_entropy((logits + shares).expand(4, 3), torch.tensor([0, 0, 0, 2]))
        (gradient,) = torch.autograd.grad(loss, logits)
        logits = (logits - gradient).detach().requires_grad_()
    assert logits[0].item() == pytest.approx(logits[2].item(), abs=0.01)
    losses = []
    for strength in (0.0, 1.0):
        protocol = {"epochs": 1, "logit_adjustment": strength}
        results = train(_settings(shapes, tmp_path / str(strength), protocol=protocol))
        losses.append(results["curves"]["train_loss"][0])
    # Equal classes need no adjustment: the same loss but for rounding and what Adam makes of it.
    assert losses[0] == pytest.approx(losses[1], rel=0.02)
    with pytest.raises(ConfigError, match=r"protocol\.logit_adjustment must not be negative, got -1\.0"):
        train(_settings(shapes, tmp_path / "x", protocol={"logit_adjustment": -1.0}))


def test_splits_do_not_overlap_and_instances_stay_apart(shapes):
    dataset = load_dataset(shapes)
    for kind in ("sample", "instance"):
        settings = read_config({"dataset": {"path": "x", "split": kind}, "output": "y"}).dataset
        parts = split(dataset, settings, "validation", 0)
        assert sorted(np.concatenate(parts)) == list(range(len(dataset)))
    assert not set(dataset.instances[parts[2]]) & set(dataset.instances[np.concatenate(parts[:2])])
    official = read_config({"dataset": {"path": "x", "split": "official"}, "output": "y"}).dataset
    with pytest.raises(DatasetError, match="no official split"):
        split(dataset, official, "validation", 0)


@pytest.mark.parametrize(
    ("dataset", "message"),
    [
        ({"classes": ["rod"]}, "single class 'rod'"),
        ({"samples_per_instance": 1}, "6 clouds leave none for choosing the epoch"),
    ],
)
def test_data_that_cannot_be_trained_on_are_an_error(shapes, tmp_path, dataset, message):
    settings = _settings(shapes, tmp_path)
    with pytest.raises(DatasetError, match=message):
        train(settings | {"dataset": settings["dataset"] | dataset})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"epoch": 3}, "unknown setting epoch"),
        ({"protocol": {"epochs": 0}}, r"protocol\.epochs must be positive, got 0"),
        ({"protocol": {"epochs": "ten"}}, r"protocol\.epochs must be int, got 'ten'"),
        ({"protocol": {"selection": "luck"}}, r"protocol\.selection must be one of"),
        ({"dataset": {"classes": ["mug"]}}, "a setting is missing in dataset"),
        ({"dataset": {"path": "x", "train_fraction": 1.5}}, r"dataset\.train_fraction must be between 0 and 1"),
        ({"preprocess": {"ordering": "groups", "group_size": 7}}, "group_size 7 does not divide"),
        ({"seed": None}, "seed must be set"),
    ],
)
def test_bad_setting_is_named_with_its_value(change, message):
    with pytest.raises(ConfigError, match=message):
        read_config({"dataset": {"path": "x"}, "output": "y"} | change)


def test_training_that_diverges_says_so(shapes, tmp_path):
    model = {"model": {"name": "pointnet_vanilla"}, "preprocess": {"ordering": "none"}}
    with pytest.raises(TrainingError, match=r"the loss is \w+ in epoch \d: learning rate .* is too high"):
        train(_settings(shapes, tmp_path, protocol={"learning_rate": 1e12}) | model)


def test_threads_are_as_they_were_afterwards():
    before = torch.get_num_threads()
    with torch_threads(before + 1):
        assert torch.get_num_threads() == before + 1
    assert torch.get_num_threads() == before


def test_training_leaves_the_arithmetic_of_the_process_alone(shapes, tmp_path):
    train(_settings(shapes, tmp_path / "run", protocol={"epochs": 1}))
    smallest = np.nextafter(np.float64(0), np.float64(1))
    assert smallest * np.float64(1) > 0
    assert torch.full((64,), 1e-310, dtype=torch.float64).mul(1.0).min() > 0
