"""The forms of a surface as numbers, and the witness that reads them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pec.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from pec.data.augment import Augment
from pec.data.tensor_dataset import PreparedClouds
from pec.known.evidence import Answers
from pec.known.form_witness import N_NUMBERS, FormWitness, form_numbers
from pec.known.surface_forms import N_FORMS, reference, surface_forms
from pec.metrics.predictions import predict_log_probabilities
from pec.networks.pec import PEC
from pec.preprocessing.preprocess import Preprocess
from pec.training.form_fit import fit_witness, network_weight
from tests.pec.conftest import CLASSES, shape

CANONICAL = Preprocess(n_candidates=128, start="farthest", pose="principal", ordering="anchors")
BEND, FACING = slice(49, 56), slice(63, 78)


def _plane(n: int = 100) -> np.ndarray:
    x, y = np.random.default_rng(0).uniform(-0.05, 0.05, (2, n))
    return np.stack([1.5 * x, y, 0 * x], axis=1).astype(np.float32)


def test_a_plane_is_flat_and_faces_one_way():
    forms = surface_forms(_plane())
    assert forms.shape == (N_FORMS,)
    assert forms[BEND] == pytest.approx(np.zeros(7), abs=1e-6)
    facing = forms[FACING].reshape(3, 5)  # the axes, the longest first: all normals lie along the last
    assert facing[:2] == pytest.approx(np.zeros((2, 5)), abs=1e-6)
    assert facing[2] == pytest.approx(np.ones(5), abs=1e-6)
    inclined, off = forms[9:49].reshape(2, 5, 4)
    assert inclined[:, 3] == pytest.approx(np.ones(5))  # parallel
    assert off[:, 0] == pytest.approx(np.ones(5))  # and each on the other's plane


def test_extents_are_those_of_the_thing():
    rng = np.random.default_rng(1)
    forms = surface_forms(CANONICAL.sample(shape("ball", rng, 500), rng))
    assert np.exp(forms[:3]) == pytest.approx([0.1] * 3, rel=0.05)  # metres


@pytest.mark.parametrize("n", [2, 3, 12, 64, 128, 300])
def test_compiled_forms_are_those_of_their_reference(n):
    cloud = np.random.default_rng(n).normal(scale=(0.05, 0.03, 0.01), size=(n, 3)).astype(np.float32) + np.float32(0.3)
    bounds = slice(None) if n > 3 else slice(0, 9)  # of fewer no plane is the only one
    assert surface_forms(cloud)[bounds] == pytest.approx(reference(cloud)[bounds], abs=1e-6)
    assert np.isfinite(surface_forms(np.repeat(cloud[:1], 64, axis=0))).all()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_no_rotation_and_no_place_changes_the_forms(seed):
    rng = np.random.default_rng(seed)
    cloud = rng.normal(scale=(0.1, 0.04, 0.02), size=(80, 3))
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    assert reference(cloud @ rotation.T + 0.3) == pytest.approx(reference(cloud), abs=1e-6)


@pytest.fixture(scope="module")
def prepared() -> PreparedClouds:
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(3), 30)
    clouds = np.stack([CANONICAL.sample(shape(CLASSES[label], rng), rng) for label in labels])
    valid = torch.ones(clouds.shape[:2], dtype=torch.bool)
    numbers = torch.arange(len(labels))
    return PreparedClouds(torch.from_numpy(clouds), valid, torch.from_numpy(labels), numbers, numbers)


def test_the_witness_learns_what_the_forms_say(prepared):
    witness = fit_witness(prepared, 3, Augment(remove=0.2), seed=1)
    rng = np.random.default_rng(5)
    samples = [CANONICAL.sample(shape(CLASSES[i % 3], rng), rng) for i in range(30)]
    numbers = form_numbers(samples)
    assert numbers.shape == (30, N_NUMBERS)
    said = witness.log_probabilities(numbers)
    assert np.exp(said).sum(axis=1) == pytest.approx(np.ones(30), abs=1e-5)
    assert (said.argmax(axis=1) == np.arange(30) % 3).mean() > 0.9
    again = fit_witness(prepared, 3, Augment(remove=0.2), seed=1)
    assert np.array_equal(again.log_probabilities(numbers), said)


def test_a_checkpoint_keeps_the_witness_and_multiplies_what_both_say(prepared, tmp_path):
    witness = fit_witness(prepared, 3, Augment())
    torch.manual_seed(0)
    alone = Checkpoint(PEC(64, 3).eval(), list(CLASSES), CANONICAL, 1.0, 1)
    write_checkpoint(tmp_path / "both", replace(alone, forms=witness))
    read = read_checkpoint(tmp_path / "both")
    assert isinstance(read.forms, FormWitness)
    clouds = prepared.candidates[::10], prepared.valid[::10]
    numbers = form_numbers(list(clouds[0].numpy()))
    by_form = torch.from_numpy(witness.log_probabilities(numbers))
    expected = (predict_log_probabilities(alone.model, CANONICAL, *clouds).double() + by_form).log_softmax(dim=1)
    both = predict_log_probabilities(read.model, CANONICAL, *clouds, read.forms)
    assert torch.allclose(both.double(), expected, atol=1e-5)


def test_answers_multiply_the_witnesses_too():
    logits = np.log(np.array([[[0.5, 0.25, 0.25]]]))
    by_form = np.log(np.array([[0.2, 0.7, 0.1]]))
    answers = Answers(logits, np.zeros((1, 2)), np.zeros((1, 37)), 3, by_form)
    product = np.array([0.5 * 0.2, 0.25 * 0.7, 0.25 * 0.1])
    assert np.exp(answers.log_probabilities) == pytest.approx(product[None] / product.sum())
    assert np.exp(answers[0:1].log_probabilities) == pytest.approx(np.exp(answers.log_probabilities))


def test_what_the_network_counts_is_what_it_is_worth_on_unseen_things():
    rng = np.random.default_rng(0)
    labels, things = np.arange(300) % 3, np.arange(300) // 2
    knows, guesses = (s * np.eye(3)[labels] + rng.normal(size=(300, 3)) for s in (3.0, 0.0))
    alike = knows + rng.normal(size=(300, 3))
    assert network_weight(guesses, knows, labels, things) < 0.1
    assert network_weight(knows, guesses, labels, things) == 4.0  # the most
    assert network_weight(knows, knows, labels, things) == pytest.approx(1.0)
    assert 0.0 < network_weight(alike, knows, labels, things) < 1.0


def test_the_network_of_a_checkpoint_counts_as_much_as_was_fitted_and_once_in_an_older_one(prepared, tmp_path):
    witness = replace(fit_witness(prepared, 3, Augment()), network_weight=np.array([0.3]))
    torch.manual_seed(0)
    alone = Checkpoint(PEC(64, 3).eval(), list(CLASSES), CANONICAL, 1.0, 1)
    write_checkpoint(tmp_path / "both", replace(alone, forms=witness))
    read = read_checkpoint(tmp_path / "both")
    clouds = prepared.candidates[::10], prepared.valid[::10]
    by_form = torch.from_numpy(witness.log_probabilities(form_numbers(list(clouds[0].numpy()))))
    by_network = predict_log_probabilities(alone.model, CANONICAL, *clouds).double()
    expected = (0.3 * by_network + by_form).log_softmax(dim=1)
    assert torch.allclose(
        predict_log_probabilities(read.model, CANONICAL, *clouds, read.forms).double(), expected, atol=1e-5
    )
    answers = Answers(by_network.numpy()[:, None], np.zeros((9, 2)), np.zeros((9, 37)), 3, by_form.numpy(), 0.3)
    assert answers.log_probabilities == pytest.approx(expected.numpy(), abs=1e-5)
    of_older = {name: values for name, values in witness.tensors().items() if name != "network_weight"}
    assert FormWitness.from_tensors(of_older).network_weight == pytest.approx([1.0])
