"""A student learns what its teacher answers, from the clouds that the teacher learnt from."""

import json
import shutil

import pytest
import torch

from pec.checkpoint import Checkpoint, read_checkpoint
from pec.distillation import Teacher
from pec.errors import ConfigError
from pec.models import build_model
from pec.preprocess import Preprocess
from pec.training import train

UPRIGHT = Preprocess(n_candidates=80, sampling="random", pose="upright", ordering="anchors")


def _settings(shapes, output, **teacher):
    return {
        "dataset": {"path": str(shapes)},
        "output": str(output),
        "preprocess": {"n_candidates": 128, "pose": "principal", "ordering": "anchors", "size": "root"},
        "protocol": {
            "epochs": 12,
            "batch_size": 16,
            "initial_weights": "scaled",
            "teacher": {"protocol": {"epochs": 8, "batch_size": 16}} | teacher,
        },
        "augment": {"remove": 0.2, "jitter": 0.001},
        "progress": False,
    }


@pytest.fixture(scope="module")
def run(shapes, tmp_path_factory):
    output = tmp_path_factory.mktemp("distilled")
    return output, train(_settings(shapes, output))


def test_the_teacher_is_trained_first_and_leaves_a_run_of_its_own(run):
    output, results = run
    teacher = json.loads((output / "teacher" / "results.json").read_text())
    assert teacher["epochs"] == 8
    assert read_checkpoint(output / "teacher" / "best").network == "pec2"
    assert read_checkpoint(output / "teacher" / "last").preprocess.size == "kept"
    assert read_checkpoint(output / "best").network == "pec"
    assert read_checkpoint(output / "best").preprocess.size == "root"
    assert teacher["n_samples"] == results["n_samples"]
    assert teacher["seed"] == results["seed"]


def test_the_student_learns_the_classes_without_a_label(run):
    _, results = run
    assert results["best"]["test_accuracy"] > 0.9


def test_neither_is_trained_again_and_a_new_student_takes_the_teacher_that_is_there(run, shapes):
    output, results = run
    weights = output / "teacher" / "last" / "model.safetensors"
    before = weights.stat().st_mtime_ns
    assert train(_settings(shapes, output)) == results
    student = (output / "last" / "model.safetensors").read_bytes()
    (output / "results.json").unlink()
    for name in ("best", "last"):
        shutil.rmtree(output / name)
    assert train(_settings(shapes, output))["best"] == results["best"]
    assert (output / "last" / "model.safetensors").read_bytes() == student
    assert weights.stat().st_mtime_ns == before


def test_answers_are_those_of_the_network_softened():
    torch.manual_seed(0)
    model = build_model("pec2", 64, 4).eval()
    points, valid, view = torch.randn(5, 80, 3), torch.ones(5, 80, dtype=torch.bool), torch.arange(5) % 4
    checkpoint = Checkpoint(model, list("abcd"), UPRIGHT, 1.0, 1, "pec2")
    sure, soft = (Teacher(checkpoint, temperature).answers(points, valid, view) for temperature in (1.0, 4.0))
    with torch.no_grad():
        logits = model(UPRIGHT.arrange(points, valid, view))
    assert torch.allclose(sure, logits.softmax(dim=1), atol=1e-5)
    assert torch.allclose(soft, (logits / 4).softmax(dim=1), atol=1e-5)


@pytest.mark.parametrize("temperature", [1.0, 3.0])
def test_nothing_is_left_to_learn_for_who_answers_alike(temperature):
    checkpoint = Checkpoint(build_model("pec2", 64, 3).eval(), list("abc"), UPRIGHT, 1.0, 1, "pec2")
    teacher = Teacher(checkpoint, temperature)
    theirs = torch.tensor([[2.0, -1.0, 0.5]])
    ours = theirs.clone().requires_grad_()
    teacher.loss(ours, (theirs / temperature).softmax(dim=1)).backward()
    assert ours.grad.abs().max() < 1e-6
    # By hand: temperature² · cross-entropy of (1/3, 1/3, 1/3) against (1, 0, 0).
    even = teacher.loss(torch.zeros(1, 3), torch.tensor([[1.0, 0.0, 0.0]]))
    assert even.item() == pytest.approx(temperature**2 * 1.0986123, rel=1e-6)


@pytest.mark.parametrize(
    ("teacher", "message"),
    [
        ({"temperature": 0.0}, r"protocol\.teacher\.temperature must be positive, got 0\.0"),
        ({"size": "big"}, r"protocol\.teacher\.size must be one of kept, unit, root, got 'big'"),
        ({"model": {"name": "me"}}, r"protocol\.teacher\.model\.name must be one of .*, got 'me'"),
        ({"protocol": {"epochs": 0}}, r"protocol\.teacher\.protocol\.epochs must be positive, got 0"),
        ({"protocol": {"selection": "evaluation split"}}, r"selection must be protocol\.selection, 'validation'"),
        ({"colour": 1}, r"unknown setting protocol\.teacher\.colour"),
    ],
)
def test_a_senseless_teacher_is_refused(shapes, tmp_path, teacher, message):
    with pytest.raises(ConfigError, match=message):
        train(_settings(shapes, tmp_path, **teacher))
