"""A class from a few clouds, without training."""

import numpy as np
import pytest

from pec import Classifier
from pec.classifier import UNKNOWN
from pec.data.loading import load_dataset
from pec.errors import CheckpointError, CloudError, ConfigError
from pec.known.enrolled import Enrolled, Nearness, fit_nearness
from pec.training.loop import train


@pytest.fixture(scope="module")
def trained(shapes, tmp_path_factory):
    output = tmp_path_factory.mktemp("enrolling")
    settings = {"dataset": {"path": str(shapes)}, "output": str(output), "progress": False}
    return train(settings | {"protocol": {"epochs": 15, "batch_size": 16}})["checkpoint"]


def _rings(n, rng, radius=0.2):
    """Thin rings in any pose, unlike any of the trained shapes."""
    rings = []
    for _ in range(n):
        angle = rng.uniform(0, 2 * np.pi, 300)
        ring = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
        rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        rings.append((ring @ rotation.T + rng.normal(scale=0.002, size=(300, 3))).astype(np.float32))
    return rings


def test_a_class_that_was_shown_is_known_and_the_others_still_are(trained, shapes):
    rng = np.random.default_rng(0)
    before = Classifier.load(trained)
    assert {answer.label for answer in before.predict(_rings(10, rng))} == {UNKNOWN}
    after = before.enrol("ring", _rings(8, rng))
    assert after.classes == ["ball", "plate", "rod", "ring"]
    assert before.classes == ["ball", "plate", "rod"]
    answers = after.predict(_rings(20, rng))
    assert np.mean([answer.label == "ring" for answer in answers]) >= 0.8
    for answer in answers:
        assert list(answer.probabilities) == after.classes
        assert sum(answer.probabilities.values()) == pytest.approx(1)
    dataset = load_dataset(shapes)
    labels = [
        (old.label, new.label)
        for old, new in zip(before.predict(dataset.clouds), after.predict(dataset.clouds), strict=True)
    ]
    assert np.mean([old == new for old, new in labels]) > 0.95


def test_what_is_like_no_class_stays_unknown(trained):
    rng = np.random.default_rng(1)
    classifier = Classifier.load(trained).enrol("ring", _rings(8, rng))
    assert {answer.label for answer in classifier.predict(_rings(10, rng, radius=0.9))} == {UNKNOWN}


def test_enrolled_classes_are_kept_in_a_checkpoint(trained, tmp_path):
    rng = np.random.default_rng(2)
    classifier = Classifier.load(trained).enrol("ring", _rings(4, rng)).enrol("hoop", _rings(1, rng, radius=0.4))
    classifier.save(tmp_path / "more")
    again = Classifier.load(tmp_path / "more", classes=["rod", "hoop", "ring", "ball", "plate"])
    clouds = _rings(5, rng)
    assert again.predict(clouds) == classifier.predict(clouds)
    (tmp_path / "more" / "enrolled.safetensors").unlink()
    with pytest.raises(CheckpointError, match=r"enrolled\.safetensors is broken"):
        Classifier.load(tmp_path / "more")


def test_what_cannot_be_enrolled_is_named(trained, tmp_path):
    classifier, rings = Classifier.load(trained), _rings(2, np.random.default_rng(3))
    with pytest.raises(ConfigError, match="there is a class 'rod' already; the classes are ball, plate, rod"):
        classifier.enrol("rod", rings)
    for name in ("", UNKNOWN):
        with pytest.raises(ConfigError, match="a class cannot be called"):
            classifier.enrol(name, rings)
    with pytest.raises(CloudError, match="class 'ring' needs at least one cloud"):
        classifier.enrol("ring", [])
    with pytest.raises(CloudError, match="cloud 1: the network takes 64 points, the cloud has only 10"):
        classifier.enrol("ring", [rings[0], rings[1][:10]])
    classifier.save(tmp_path / "old")
    (tmp_path / "old" / "knowing.safetensors").unlink()
    with pytest.raises(CheckpointError, match="train it anew"):
        Classifier.load(tmp_path / "old").enrol("ring", rings)


def test_ninety_five_in_a_hundred_other_clouds_of_a_thing_pass():
    rng = np.random.default_rng(0)
    centres = rng.normal(size=(60, 37))
    things = np.repeat(np.arange(60), 24)
    descriptors = centres[things] + rng.normal(scale=0.2, size=(len(things), 37))
    nearness = fit_nearness(descriptors, things, threshold=0.7)
    passed, others = [], []
    for centre in rng.normal(size=(100, 37)):
        clouds = centre + rng.normal(scale=0.2, size=(40, 37))
        shown = Enrolled().with_class("it", clouds[:8])
        passed.append(_known(shown, nearness, clouds[8:]) >= 0.7)
        others.append(_known(shown, nearness, rng.normal(size=(20, 37))) >= 0.7)
    assert np.mean(passed) == pytest.approx(0.95, abs=0.03)
    assert np.mean(others) < 0.02


def _known(shown, nearness, descriptors):
    """Where nothing is of the trained class."""
    return shown.answer(nearness, descriptors, np.ones((len(descriptors), 1)), np.zeros(len(descriptors)))[1]


def test_more_clouds_than_could_be_measured_are_nearer_still():
    rng = np.random.default_rng(1)
    things = np.repeat(np.arange(80), 3)
    descriptors = rng.normal(size=(80, 37))[things] + rng.normal(size=(240, 37)) * rng.normal(size=37)
    typical = fit_nearness(descriptors, things, threshold=0.5).typical
    falls = np.diff(typical)
    assert (falls < 0).all()
    np.testing.assert_allclose(falls[1:], falls[0])


def test_each_class_trained_or_shown_is_as_likely_before_anything_is_seen():
    nearness = Nearness(np.zeros(37), np.ones(37), np.zeros(6), slope=-2.0, offset=5.0, middle=0.5)
    shown = Enrolled().with_class("it", np.zeros((1, 37)))
    away = np.zeros((1, 37))
    away[0, 0] = np.exp(0.5) - 1e-3  # as likely of another thing
    trained = np.full((1, 14), 1 / 14)
    probabilities, known = shown.answer(nearness, away, trained, np.array([0.5]))
    np.testing.assert_allclose(probabilities, 1 / 15)
    assert known == pytest.approx(0.5)
    probabilities, known = shown.answer(nearness, np.zeros((1, 37)), trained, np.array([0.5]))
    assert probabilities[0, 14] > 0.99
    assert known > 0.99
