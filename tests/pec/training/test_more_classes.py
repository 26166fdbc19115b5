"""A finished run learns a class more, and forgets none."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pec.checkpoint import Checkpoint
from pec.classifier import Classifier
from pec.errors import CloudError, ConfigError
from pec.networks.registry import build_model
from pec.preprocessing.preprocess import Preprocess
from pec.training import fit, train
from pec.training.more_classes import epochs_for, with_outputs
from tests.pec.conftest import shape, write_shapes


def _cube(rng: np.random.Generator) -> np.ndarray:
    """(200, 3) points on a cube's surface at a random pose."""
    points = rng.uniform(-0.04, 0.04, (200, 3))
    points[np.arange(200), rng.integers(3, size=200)] = rng.choice([-0.04, 0.04], 200)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return (points @ rotation.T + [0, 0, 0.5]).astype(np.float32)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    directory = tmp_path_factory.mktemp("more_classes")
    write_shapes(directory / "data", samples_per_instance=10, instances=5)
    train(
        {
            "dataset": {"path": str(directory / "data")},
            "model": {"name": "pec2"},
            "protocol": {"epochs": 10, "batch_size": 32, "precision": "float32"},
            "output": str(directory / "run"),
            "progress": False,
        }
    )
    return directory / "run"


def test_a_class_more_is_learnt_and_none_is_forgotten(run, tmp_path):
    rng = np.random.default_rng(7)
    before = Classifier.load(run / "best")
    after = fit(run, {"cube": [_cube(rng) for _ in range(12)]}, epochs=5)
    assert before.classes == ["ball", "plate", "rod"]
    assert after.classes == ["ball", "plate", "rod", "cube"]
    for name in after.classes:
        clouds = [_cube(rng) if name == "cube" else shape(name, rng) for _ in range(20)]
        answers = [max(answer.probabilities.items(), key=lambda of: of[1])[0] for answer in after.predict(clouds)]
        assert answers.count(name) >= 18, name
    after.save(tmp_path / "more")
    again = Classifier.load(tmp_path / "more")
    cloud = _cube(rng)
    assert again.predict(cloud) == after.predict(cloud)


@pytest.mark.parametrize("network", ["pec", "pec2", "pointnet"])
def test_what_the_network_said_of_the_others_it_says_with_more_outputs(network):
    model = build_model(network, 64, 4).eval()
    preprocess = Preprocess(n_candidates=128, start="farthest", pose="principal", ordering="anchors")
    checkpoint = Checkpoint(model, ["a", "b", "c"], preprocess, 1.0, 1, network, none_of_these=True)
    more = with_outputs(checkpoint, 6).eval()
    points = torch.randn(5, 64, 3, generator=torch.Generator().manual_seed(0))
    assert torch.allclose(more(points)[:, [0, 1, 2, 5]], model(points), atol=1e-6)


def test_large_runs_are_passed_over_less_often_so_that_teaching_takes_minutes():
    assert [epochs_for(n) for n in (10, 6_000, 8_000, 15_000, 100_000)] == [10, 10, 7, 4, 3]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_classifier(run):
    clouds = {"cube": [_cube(np.random.default_rng(i)) for i in range(5)]}
    cloud = shape("rod", np.random.default_rng(99))
    first, second = (fit(run, clouds, epochs=1, seed=3).predict(cloud) for _ in range(2))
    assert first == second


def test_what_cannot_be_learnt_is_named(run):
    cloud = _cube(np.random.default_rng(0))
    with pytest.raises(ConfigError, match="'ball' already"):
        fit(run, {"ball": [cloud] * 5})
    with pytest.raises(ConfigError, match="cannot be called 'unknown'"):
        fit(run, {"unknown": [cloud] * 5})
    with pytest.raises(ConfigError, match="no class"):
        fit(run, {})
    with pytest.raises(CloudError, match="has 4 clouds"):
        fit(run, {"cube": [cloud] * 4})
    with pytest.raises(CloudError, match="'cube', cloud 1: "):
        fit(run, {"cube": [cloud, cloud[:10], cloud, cloud, cloud]})
