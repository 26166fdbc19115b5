"""From a checkpoint to answers, and what happens when either is bad."""

import json
import shutil

import numpy as np
import pytest
import torch

from pec import PEC, Classifier
from pec.checkpoint import Checkpoint, write_checkpoint
from pec.classifier import UNKNOWN
from pec.data.loading import load_dataset
from pec.errors import CheckpointError, CloudError, ConfigError
from pec.metrics.calibration import expected_calibration_error, fit_temperature
from pec.metrics.predictions import average_views
from pec.metrics.rejection import rejection_threshold
from pec.metrics.scores import score
from pec.preprocessing.preprocess import Preprocess

CLASSES = ["can", "mug", "box"]
CANONICAL = Preprocess(n_candidates=128, start="farthest", pose="principal", ordering="anchors")


def _write(directory, preprocess=CANONICAL, temperature=1.0, classes=CLASSES):
    torch.manual_seed(0)
    model = PEC(64, len(classes))
    write_checkpoint(directory, Checkpoint(model, classes, preprocess, temperature, 1))
    return directory


@pytest.fixture
def checkpoint(tmp_path):
    return _write(tmp_path / "checkpoint")


def _clouds(n: int = 5) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [rng.normal(size=(size, 3)) * 0.05 + [0, 0, 0.6] for size in rng.integers(64, 500, n)]


@pytest.mark.parametrize("preprocess", [CANONICAL, Preprocess()])
def test_cloud_is_classified_alike_alone_and_in_a_list(tmp_path, preprocess):
    classifier = Classifier.load(_write(tmp_path / "c", preprocess))
    clouds = _clouds()
    together = classifier.predict(clouds)
    for cloud, prediction in zip(clouds, together, strict=True):
        alone = classifier.predict(cloud)
        assert alone.label == prediction.label
        assert alone.probabilities == pytest.approx(prediction.probabilities, abs=1e-5)
        assert alone.confidence == max(alone.probabilities.values())
        assert list(alone.probabilities) == CLASSES
        assert sum(alone.probabilities.values()) == pytest.approx(1, abs=1e-5)
    assert classifier.predict([]) == []


def test_trained_classifier_knows_its_shapes(shapes, tmp_path):
    from pec.training.loop import train

    protocol = {"epochs": 15, "batch_size": 16, "made_strangers": 0.0}
    settings = {"dataset": {"path": str(shapes)}, "output": str(tmp_path), "protocol": protocol, "progress": False}
    classifier = Classifier.load(train(settings)["checkpoint"], classes=["rod", "plate", "ball"])
    dataset = load_dataset(shapes)
    answers = classifier.predict([dataset.cloud(i) for i in range(len(dataset))])
    right = [answer.label == dataset.classes[label] for answer, label in zip(answers, dataset.labels, strict=True)]
    assert np.mean(right) > 0.9


def test_temperature_softens_but_does_not_change_the_answer(tmp_path):
    cold = Classifier.load(_write(tmp_path / "cold", temperature=0.1))
    warm = Classifier.load(_write(tmp_path / "warm", temperature=10.0))
    for cloud in _clouds():
        assert cold.predict(cloud).label == warm.predict(cloud).label
        assert cold.predict(cloud).confidence > warm.predict(cloud).confidence


def test_bad_cloud_in_a_list_is_named_by_its_place(checkpoint):
    classifier = Classifier.load(checkpoint)
    clouds = _clouds(3)
    clouds[1][7, 2] = np.nan
    with pytest.raises(CloudError, match=r"cloud 1: 1 of .* not finite"):
        classifier.predict(clouds)
    with pytest.raises(CloudError, match="takes 64 points, the cloud has only 63"):
        classifier.predict(np.zeros((63, 3)))


def _edit(checkpoint, **changes):
    config = json.loads((checkpoint / "config.json").read_text())
    (checkpoint / "config.json").write_text(json.dumps(config | changes))


def test_missing_or_broken_checkpoint_is_named(checkpoint, tmp_path):
    with pytest.raises(CheckpointError, match=r"nowhere/config\.json does not exist"):
        Classifier.load(tmp_path / "nowhere")
    _edit(checkpoint, format=7)
    with pytest.raises(CheckpointError, match="format 7"):
        Classifier.load(checkpoint)
    (checkpoint / "config.json").write_text("{")
    with pytest.raises(CheckpointError, match=r"config\.json is broken"):
        Classifier.load(checkpoint)


def test_weights_that_do_not_fit_are_an_error(checkpoint):
    _edit(checkpoint, classes=["can", "mug"])
    with pytest.raises(CheckpointError, match="do not fit 2 classes"):
        Classifier.load(checkpoint)
    weights = checkpoint / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:5000])
    with pytest.raises(CheckpointError, match=r"model\.safetensors is broken"):
        Classifier.load(checkpoint)
    weights.unlink()
    with pytest.raises(CheckpointError, match=r"model\.safetensors does not exist"):
        Classifier.load(checkpoint)


def test_another_class_list_is_an_error(checkpoint):
    assert Classifier.load(checkpoint, classes=["box", "can", "mug"]).classes == CLASSES
    with pytest.raises(CheckpointError, match="knows the classes can, mug, box, not can, drill"):
        Classifier.load(checkpoint, classes=["can", "drill"])


def test_checkpoint_is_replaced_as_a_whole(checkpoint):
    before = Classifier.load(checkpoint).predict(_clouds(1)[0])
    _write(checkpoint, temperature=3.0)
    after = Classifier.load(checkpoint).predict(_clouds(1)[0])
    assert after.label == before.label
    assert after.confidence != before.confidence
    assert [path.name for path in checkpoint.parent.iterdir()] == ["checkpoint"]
    shutil.rmtree(checkpoint)


def test_average_of_views_is_the_mean_probability():
    logits = torch.randn(4, 7, 3, generator=torch.Generator().manual_seed(0))
    assert torch.allclose(average_views(logits).exp(), logits.softmax(dim=2).mean(dim=0), atol=1e-6)


def test_temperature_is_recovered():
    generator = torch.Generator().manual_seed(0)
    true_logits = 2 * torch.randn(20_000, 4, generator=generator)
    labels = torch.multinomial(true_logits.softmax(dim=1), 1, generator=generator)[:, 0]
    assert fit_temperature(2.5 * true_logits, labels) == pytest.approx(2.5, rel=0.05)
    calibrated, overconfident = true_logits.softmax(dim=1), (2.5 * true_logits).softmax(dim=1)
    assert expected_calibration_error(calibrated, labels) < 0.02
    assert expected_calibration_error(overconfident, labels) > 0.05


def test_ten_right_answers_are_not_certainty():
    log_probabilities = torch.full((10, 3), 0.01).log()
    log_probabilities[:, 0] = torch.tensor(0.98).log()
    temperature = fit_temperature(log_probabilities, torch.zeros(10, dtype=torch.int64))
    confidence = (log_probabilities / temperature).softmax(dim=1)[:, 0]
    assert confidence.numpy() == pytest.approx(11 / 12, abs=1e-5)


def test_scores_of_a_known_case():
    probabilities = torch.tensor([[0.8, 0.1, 0.1], [0.6, 0.3, 0.1], [0.1, 0.2, 0.7], [0.2, 0.5, 0.3]])
    scores = score(probabilities.log(), torch.tensor([0, 1, 2, 1]))
    assert scores.accuracy == 0.75
    assert scores.confusion == [[1, 0, 0], [1, 1, 0], [0, 0, 1]]
    assert scores.per_class == [1.0, 0.5, 1.0]


def test_at_most_the_promised_share_of_known_objects_is_rejected():
    generator = torch.Generator().manual_seed(0)
    rejected = []
    for _ in range(300):
        confidences = torch.rand(700, generator=generator) ** 0.2
        threshold = rejection_threshold(confidences[:200], rate=0.05)
        rejected.append((confidences[200:] < threshold).double().mean().item())
    assert 0.03 < np.mean(rejected) <= 0.05
    assert rejection_threshold(torch.tensor([0.9, 0.2, 0.7]), rate=0.3) == pytest.approx(0.2)
    assert rejection_threshold(torch.rand(18, generator=generator)) == 0.0  # too few to promise one in twenty
    assert rejection_threshold(torch.rand(19, generator=generator)) > 0.0


def test_below_its_threshold_a_cloud_is_of_no_known_class(tmp_path):
    known = Classifier.load(_write(tmp_path / "c"))
    cloud = _clouds(1)[0]
    answer = known.predict(cloud)
    assert answer.label in CLASSES
    above = Classifier.load(tmp_path / "c", unknown_below=answer.confidence + 1e-3).predict(cloud)
    assert above.label == UNKNOWN
    assert (above.confidence, above.probabilities) == (answer.confidence, answer.probabilities)
    assert answer.known == answer.confidence  # this checkpoint has nothing else to know by
    assert Classifier.load(tmp_path / "c", unknown_below=answer.confidence - 1e-3).predict(cloud) == answer
    with pytest.raises(ConfigError, match=r"unknown_below must be in \[0, 1\], got 1\.5"):
        Classifier.load(tmp_path / "c", unknown_below=1.5)


def test_threshold_is_kept_in_the_checkpoint_and_older_ones_have_none(tmp_path):
    torch.manual_seed(0)
    write_checkpoint(tmp_path / "c", Checkpoint(PEC(64, 3), CLASSES, CANONICAL, 1.0, 1, unknown_below=0.99))
    assert Classifier.load(tmp_path / "c").predict(_clouds(1)[0]).label == UNKNOWN
    config = json.loads((tmp_path / "c" / "config.json").read_text())
    del config["unknown_below"]
    (tmp_path / "c" / "config.json").write_text(json.dumps(config))
    assert Classifier.load(tmp_path / "c").predict(_clouds(1)[0]).label in CLASSES
