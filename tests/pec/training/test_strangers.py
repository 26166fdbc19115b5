"""A run on classes and strangers, from the data to an answer."""

import json

import numpy as np
import pytest

from pec import Classifier
from pec.checkpoint import read_checkpoint
from pec.classifier import UNKNOWN
from pec.data.loading import load_dataset
from pec.errors import CheckpointError, ConfigError
from pec.training.config import read_config
from pec.training.finished_runs import read_finished
from pec.training.loop import train


def _settings(data, output, **changes):
    protocol = {"epochs": 15, "batch_size": 16, "made_strangers": 0.0, **changes.pop("protocol", {})}
    settings = {"dataset": {"path": str(data)}, "output": str(output), "protocol": protocol, "progress": False}
    return {**settings, "augment": {"jitter": 0.001}, **changes}


def _with_balls_unknown(shapes):
    """The shapes as a .npz: plates and rods known, balls strangers."""
    from pec.data.labelled_arrays import write_labelled

    dataset = load_dataset(shapes)
    path = shapes.parent / "balls_unknown.npz"
    names = [UNKNOWN if name == "ball" else name for name in dataset.classes]
    write_labelled(path, dataset.clouds, dataset.labels.tolist(), [str(i) for i in dataset.instances], names)
    return path


@pytest.fixture(scope="module")
def run(shapes, tmp_path_factory):
    output = tmp_path_factory.mktemp("strangers")
    data = _with_balls_unknown(shapes)
    return data, output, train(_settings(data, output))


def test_strangers_are_refused_and_the_known_are_told_apart(run):
    data, _, results = run
    assert results["classes"] == ["plate", "rod"]
    classifier = Classifier.load(results["checkpoint"])
    assert classifier.classes == ["plate", "rod"]
    dataset = load_dataset(data)
    answers = classifier.predict(dataset.clouds)
    stranger = ~dataset.is_known
    known = np.array([answer.known for answer in answers])
    assert known[~stranger].mean() > 0.8 > 0.2 > known[stranger].mean()
    right = [a.label == dataset.classes[k] for a, k in zip(answers, dataset.labels, strict=True)]
    assert np.mean(right) > 0.9
    for answer in answers:
        assert list(answer.probabilities) == ["plate", "rod"]
        assert sum(answer.probabilities.values()) == pytest.approx(1)
        assert answer.confidence == max(answer.probabilities.values())


def test_results_say_what_became_of_the_strangers(run):
    _, output, results = run
    best = results["best"]
    assert np.array(best["test_confusion"]).sum() == 20  # of the two classes only
    assert best["test_strangers_refused"] > 0.8
    assert best["test_known_auc"] > 0.95
    assert set(best["known_weights"]) == {"none of these", "energy", "features", "shape", "size"}
    assert results["n_samples"]["strangers_in_training"] == 28
    assert any("plate, rod" in warning and "instances that training sees" in warning for warning in results["warnings"])
    config = json.loads((output / "best" / "config.json").read_text())
    assert config["none_of_these"] is True
    assert read_checkpoint(output / "best").n_outputs == 3


def test_comparisons_see_the_known_clouds_only(run):
    _, output, _ = run
    finished = read_finished(output)
    assert finished.test.classes == ["plate", "rod"]
    assert len(finished.test) == 20


def test_a_checkpoint_without_what_it_knows_by_falls_back_to_its_confidence(run, tmp_path):
    import shutil

    data, output, _ = run
    copy = shutil.copytree(output / "best", tmp_path / "copy")
    (copy / "knowing.safetensors").unlink()
    cloud = load_dataset(data).cloud(0)
    answer = Classifier.load(copy).predict(cloud)
    assert answer.known == answer.confidence
    (copy / "knowing.safetensors").write_bytes(b"no tensors")
    with pytest.raises(CheckpointError, match=r"knowing\.safetensors is broken"):
        Classifier.load(copy)


@pytest.mark.parametrize("model", ["pec2", "knn", "pointnet_vanilla"])
def test_other_networks_know_strangers_too(shapes, tmp_path, model):
    preprocess = {} if model == "pec2" else {"preprocess": {"ordering": "none", "n_points": 64, "n_candidates": 64}}
    if not preprocess:
        preprocess = {
            "preprocess": {"n_candidates": 128, "start": "farthest", "pose": "principal", "ordering": "anchors"}
        }
    data = _with_balls_unknown(shapes)
    results = train(_settings(data, tmp_path, model={"name": model}, protocol={"epochs": 3}, **preprocess))
    clouds = load_dataset(data).clouds
    assert {answer.label for answer in Classifier.load(results["checkpoint"]).predict(clouds)} <= {
        "plate",
        "rod",
        UNKNOWN,
    }


def test_strangers_are_made_where_nobody_gives_any(shapes, tmp_path):
    results = train(_settings(shapes, tmp_path, protocol={"made_strangers": 0.5, "epochs": 20}))
    assert results["n_samples"]["strangers_in_training"] == 42
    checkpoint = read_checkpoint(tmp_path / "best")
    assert checkpoint.classes == ["ball", "plate", "rod"]
    assert checkpoint.none_of_these
    classifier = Classifier.load(results["checkpoint"])
    rng = np.random.default_rng(0)
    torus = rng.normal(size=(200, 3)) * [1, 1, 0]
    torus = 0.2 * torus / np.linalg.norm(torus, axis=1, keepdims=True) + rng.normal(scale=0.01, size=(200, 3))
    seen = classifier.predict(load_dataset(shapes).clouds)
    assert classifier.predict(torus).known < np.quantile([answer.known for answer in seen], 0.05)


def test_senseless_settings_are_refused(shapes, tmp_path):
    with pytest.raises(ConfigError, match=r"protocol\.made_strangers must not be negative, got -1"):
        read_config(_settings(shapes, tmp_path, protocol={"made_strangers": -1}))
    with pytest.raises(ConfigError, match=r"dataset\.calibration_fraction must be in \[0, 1\), got 1"):
        read_config(_settings(shapes, tmp_path) | {"dataset": {"path": "x", "calibration_fraction": 1.0}})


def test_no_strangers_are_made_where_enough_are_given(run, tmp_path):
    data, _, _ = run
    results = train(_settings(data, tmp_path, protocol={"made_strangers": 0.5, "epochs": 1}))
    assert results["n_samples"]["strangers_in_training"] == 28  # for 56 known clouds
    more = train(_settings(data, tmp_path / "more", protocol={"made_strangers": 0.75, "epochs": 1}))
    assert more["n_samples"]["strangers_in_training"] == 42
