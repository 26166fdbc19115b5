"""The exported network says in onnxruntime what it says in torch, and its metadata is enough to use it."""

import json

import numpy as np
import pytest
import torch

from pec import Classifier
from pec.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from pec.errors import ConfigError
from pec.networks.registry import MODELS, build_model
from pec.onnx_export import export_onnx
from pec.preprocessing.preprocess import Preprocess

onnxruntime = pytest.importorskip("onnxruntime", reason="an extra: pip install '.[onnx]'")
CLASSES = ["can", "mug", "box"]


def _checkpoint(name: str, preprocess: Preprocess) -> Checkpoint:
    torch.manual_seed(0)
    model = build_model(name, 64, 3)
    model.train()(0.05 * torch.randn(40, 64, 3))  # batch norm gets statistics other than 0 and 1
    return Checkpoint(model.eval(), CLASSES, preprocess, 0.3, 1, name, unknown_below=0.4)


def test_classifier_can_be_built_of_the_exported_file(tmp_path):
    preprocess = Preprocess(n_candidates=128, start="farthest", pose="principal", ordering="anchors")
    write_checkpoint(tmp_path / "checkpoint", _checkpoint("pec", preprocess))
    path = export_onnx(read_checkpoint(tmp_path / "checkpoint"), tmp_path / "new" / "model.onnx")
    assert [file.name for file in path.parent.iterdir()] == ["model.onnx"]
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    said = {name: json.loads(value) for name, value in session.get_modelmeta().custom_metadata_map.items()}
    assert said["classes"] == CLASSES
    assert said["unknown_below"] == 0.4
    arrange = Preprocess(**said["preprocess"])
    assert arrange == preprocess
    cloud = np.random.default_rng(0).normal(size=(300, 3)).astype(np.float32) * 0.05
    expected = Classifier.load(tmp_path / "checkpoint", unknown_below=0).predict(cloud)

    sample = torch.from_numpy(arrange.sample(cloud, np.random.default_rng(0)))[None]
    valid = torch.ones(sample.shape[:2], dtype=torch.bool)
    poses = torch.cat([arrange.arrange(sample, valid, torch.tensor([view])) for view in range(arrange.n_views)])
    (logits,) = session.run(["logits"], {"points": poses.numpy()})
    assert logits.shape == (4, 3)
    shares = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    tempered = shares.mean(axis=0) ** (1 / said["temperature"])
    assert tempered / tempered.sum() == pytest.approx(list(expected.probabilities.values()), abs=1e-5)


@pytest.mark.slow
# CurveNet walks step by step: its export takes minutes.
@pytest.mark.parametrize("name", [name for name in MODELS if name not in ("pec", "knn", "forest", "curvenet")])
def test_other_networks_are_the_same_in_onnxruntime(name, tmp_path):
    checkpoint = _checkpoint(name, Preprocess(ordering="none"))  # of which the export uses the number of points
    session = onnxruntime.InferenceSession(str(export_onnx(checkpoint, tmp_path / "model.onnx")))
    for batch in (1, 5):
        points = 0.05 * torch.randn(batch, 64, 3)
        (logits,) = session.run(None, {"points": points.numpy()})
        with torch.no_grad():
            assert torch.allclose(torch.from_numpy(logits), checkpoint.model(points), atol=1e-5)


def test_what_is_no_network_is_refused(tmp_path):
    model = build_model("knn", 64, 3)
    with pytest.raises(ConfigError, match="knn is not a network"):
        export_onnx(Checkpoint(model, CLASSES, Preprocess(ordering="none"), 1.0, 1, "knn"), tmp_path / "model.onnx")
    assert not (tmp_path / "model.onnx").exists()
