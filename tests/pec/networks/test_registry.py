"""A network of one's own, by its dotted name."""

import json

import pytest
from torch import nn

from pec.checkpoint import read_checkpoint
from pec.classifier import Classifier
from pec.data.loading import load_dataset
from pec.errors import CheckpointError, ConfigError
from pec.networks.registry import build_model
from pec.training import train

SOURCE = """
from torch import nn

class Flat(nn.Sequential):
    def __init__(self, n_points, n_classes):
        super().__init__(nn.Flatten(), nn.Linear(3 * n_points, n_classes))

def not_a_network(n_points, n_classes):
    raise AssertionError("called")
"""


@pytest.fixture
def own_module(tmp_path, monkeypatch):
    (tmp_path / "flat_network.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(tmp_path)
    return "flat_network"


def test_own_network_is_trained_and_loaded_by_its_dotted_name(own_module, shapes, tmp_path):
    settings = {
        "dataset": {"path": str(shapes)},
        "model": {"name": f"{own_module}.Flat"},
        "output": str(tmp_path / "run"),
        "protocol": {"epochs": 1, "made_strangers": 0.0},
        "progress": False,
    }
    results = train(settings)
    assert results["parameters"] == (3 * 64 + 1) * 3
    assert isinstance(read_checkpoint(results["checkpoint"]).model, nn.Sequential)
    classifier = Classifier.load(results["checkpoint"])
    assert classifier.predict(load_dataset(shapes).cloud(0)).label in classifier.classes


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("resnet", r"must be one of pec, .* or module\.Class of your own, got 'resnet'"),
        ("nowhere_at_all.Net", r"No module named 'nowhere_at_all'; is the folder of nowhere_at_all\.py on PYTHONPATH"),
        ("flat_network.Deep", "flat_network has no subclass of torch.nn.Module of that name"),
        ("flat_network.not_a_network", "flat_network has no subclass of torch.nn.Module of that name"),
    ],
)
def test_what_is_no_network_is_named_with_the_way_out(own_module, name, message):
    with pytest.raises(ConfigError, match=message):
        build_model(name, 64, 3)


def test_checkpoint_of_a_network_that_is_not_there_is_refused(own_module, shapes, tmp_path):
    settings = {"dataset": {"path": str(shapes)}, "output": str(tmp_path), "protocol": {"epochs": 1}, "progress": False}
    checkpoint = tmp_path / "best"
    train(settings)
    config = json.loads((checkpoint / "config.json").read_text())
    (checkpoint / "config.json").write_text(json.dumps(config | {"network": f"{own_module}.not_a_network"}))
    with pytest.raises(CheckpointError, match=r"no subclass of torch\.nn\.Module"):
        Classifier.load(checkpoint)
