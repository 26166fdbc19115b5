"""What is measured of a cloud, and the one probability that it comes to."""

import numpy as np
import pytest
import torch

from pec.known.enrolled import Nearness
from pec.known.evidence import SCORES, Answers, scores
from pec.known.fit import find_prototypes, fit_known, known_of_unseen
from pec.known.knowing import Knowing, logistic
from pec.known.shape_distribution import describe_cloud, reference
from pec.metrics.rejection import area_under_roc
from pec.networks.baselines.knn import describe


def test_descriptor_is_that_of_the_nearest_neighbour_classifier():
    clouds = np.random.default_rng(0).normal(scale=0.05, size=(5, 64, 3)).astype(np.float32)
    reference = describe(torch.from_numpy(clouds)).numpy()
    assert np.stack([describe_cloud(cloud) for cloud in clouds]) == pytest.approx(reference, abs=1e-6)


@pytest.mark.parametrize("n", [1, 2, 3, 64, 200])
def test_compiled_descriptor_is_that_of_its_reference(n):
    cloud = np.random.default_rng(n).normal(scale=0.05, size=(n, 3)).astype(np.float32) + np.float32(0.3)
    assert describe_cloud(cloud) == pytest.approx(reference(cloud), abs=1e-7)
    assert describe_cloud(np.repeat(cloud[:1], 64, axis=0)) == pytest.approx(np.zeros(37), abs=1e-7)


def test_no_rotation_and_no_place_changes_a_descriptor():
    rng = np.random.default_rng(0)
    cloud = rng.normal(scale=(0.1, 0.04, 0.01), size=(80, 3))
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    assert describe_cloud(cloud @ rotation.T + 0.3) == pytest.approx(describe_cloud(cloud), abs=1e-6)
    assert describe_cloud(2 * cloud) == pytest.approx(2 * describe_cloud(cloud), rel=1e-5)


def _answers(rng, n, centre, none=None):
    """n clouds whose features lie about `centre` (2,), which the network takes for class 0 with logits 4 and 0."""
    logits = np.tile([4.0, 0.0] if none is None else [4.0, 0.0, none], (n, 4, 1)) + rng.normal(
        scale=0.1, size=(n, 4, 1)
    )
    descriptors = np.abs(rng.normal(0.1, 0.01, size=(n, 37)))
    return Answers(logits, centre + rng.normal(size=(n, 2)), descriptors, 2)


def _fitted(rng, none=(None, None)):
    training = _answers(rng, 200, 0.0, none[0])
    prototypes = find_prototypes(training, np.arange(200) % 2)
    known, strangers = _answers(rng, 60, 0.0, none[0]), _answers(rng, 60, 9.0, none[1])
    both = Answers(
        *(
            np.concatenate([getattr(a, name) for a in (known, strangers)])
            for name in ("logits", "features", "descriptors")
        ),
        2,
    )
    model = fit_known(prototypes, both, np.arange(120) >= 60, np.arange(120))
    knowing = Knowing(prototypes, *model, Nearness(np.zeros(37), np.ones(37), np.zeros(6), -1.0, 0.0, 0.0))
    return knowing, known, strangers


def test_known_is_high_for_the_known_and_low_for_strangers():
    knowing, known, strangers = _fitted(np.random.default_rng(0))
    of_known, of_strangers = (knowing.known(a) for a in (known, strangers))
    assert of_known.min() > 0.5 > of_strangers.max()
    assert ((of_known <= 1) & (of_strangers >= 0)).all()


def test_no_score_that_says_strange_makes_a_cloud_more_known():
    for none in ((None, None), (-4.0, 4.0)):
        knowing, known, _ = _fitted(np.random.default_rng(1), none)
        assert (knowing.weights <= 0).all()
        values = scores(known, knowing.prototypes)
        for place in range(len(SCORES)):
            stranger = values.copy()
            stranger[:, place] += 1
            before, after = (
                logistic(each, knowing.centre, knowing.unit, knowing.weights, knowing.bias)
                for each in (values, stranger)
            )
            assert (after <= before).all()


def test_what_the_network_says_of_strangers_counts():
    silent, _, _ = _fitted(np.random.default_rng(2))
    asked, _, _ = _fitted(np.random.default_rng(2), (-4.0, 4.0))
    assert silent.weights[SCORES.index("none of these")] == 0
    assert asked.weights[SCORES.index("none of these")] < 0


def test_a_model_survives_a_file(tmp_path):
    knowing, known, _ = _fitted(np.random.default_rng(3))
    again = Knowing.from_tensors(knowing.tensors())
    assert np.array_equal(again.known(known), knowing.known(known))


def test_area_under_the_curve_of_known_cases():
    assert area_under_roc(np.array([0.9, 0.8]), np.array([0.1, 0.2, 0.3])) == 1.0
    assert area_under_roc(np.array([0.1]), np.array([0.9])) == 0.0
    assert area_under_roc(np.array([0.5, 0.5]), np.array([0.5])) == 0.5
    assert area_under_roc(np.array([0.4, 0.9]), np.array([0.5, 0.9])) == pytest.approx((0.5 + 1) / 4)


def _unseen(rng, things, n_known):
    """Clouds of things that lie about 0 in twenty features, those from `n_known` on, strangers, about 3."""
    centres = rng.normal(size=(things.max() + 1, 20))
    centres[n_known:] += 3
    features = centres[things] + rng.normal(scale=0.1, size=(len(things), 20))
    logits = rng.normal(scale=0.1, size=(len(things), 1, 2))
    return Answers(logits, features, np.abs(rng.normal(0.1, 0.01, size=(len(things), 37))), 2)


def test_each_cloud_is_judged_by_a_model_that_was_fitted_without_its_thing():
    rng = np.random.default_rng(0)
    prototypes = find_prototypes(_unseen(rng, np.arange(200), 200), np.arange(200) % 2)
    things = np.repeat(np.arange(12), 6)
    answers, stranger = _unseen(rng, things, 6), things >= 6
    known = known_of_unseen(prototypes, answers, stranger, things)
    assert known.shape == (36,)
    changed = Answers(answers.logits, answers.features.copy(), answers.descriptors, 2)
    changed.features[:6] += 5.0  # thing 0: models of the other folds have seen it, its own has not
    others = known_of_unseen(prototypes, changed, stranger, things)
    assert (others[:6] < known[:6]).all()
    assert np.abs(others[6:] - known[6:]).max() > 1e-4
    model = fit_known(prototypes, answers, stranger, things)
    assert known.mean() < logistic(scores(answers[~stranger], prototypes), *model).mean()


def test_a_single_known_thing_is_judged_by_the_model_that_has_seen_it():
    rng = np.random.default_rng(1)
    prototypes = find_prototypes(_unseen(rng, np.arange(100), 100), np.arange(100) % 2)
    things = np.repeat([0, 1, 2, 3], 5)
    answers, stranger = _unseen(rng, things, 1), things > 0
    model = fit_known(prototypes, answers, stranger, things)
    known = known_of_unseen(prototypes, answers, stranger, things)
    assert known == pytest.approx(logistic(scores(answers[:5], prototypes), *model))
