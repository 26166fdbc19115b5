"""A student learns what its teacher answers, from the clouds that the teacher learnt from."""

import json
import shutil
import signal
import subprocess
import sys
import time

import pytest
import torch
from safetensors.torch import load_file, save_file

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
    assert results["teacher"] == {
        "training_s": teacher["training_s"],
        "test_accuracy": teacher["last"]["test_accuracy"],
    }


def test_the_student_learns_what_it_is_told_and_not_the_labels(run, shapes, tmp_path):
    output, results = run
    assert results["best"]["test_accuracy"] > 0.9
    shutil.copytree(output / "teacher", tmp_path / "teacher")
    weights = tmp_path / "teacher" / "last" / "model.safetensors"
    tensors = load_file(weights)
    for layer in ("head.1", "size.8"):  # its answers, each for the class after the right one
        for part in ("weight", "bias"):
            tensors[f"{layer}.{part}"] = tensors[f"{layer}.{part}"].roll(1, dims=0).contiguous()
    save_file(tensors, weights)
    misled = train(_settings(shapes, tmp_path))
    assert misled["last"]["test_accuracy"] < 0.1
    confusion = torch.tensor(misled["last"]["test_confusion"])
    assert confusion.roll(-1, dims=1).diag().sum() > 0.8 * confusion.sum()


def test_what_is_killed_at_any_time_ends_in_the_same_weights(run, shapes, tmp_path):
    output, _ = run
    settings = _settings(shapes, tmp_path)
    for part, epochs in (("teacher/last", 2), ("last", 3)):
        process = subprocess.Popen([sys.executable, "-c", f"from pec.training import train; train({settings!r})"])
        deadline = time.monotonic() + 60
        while _epochs_done(tmp_path / part) < epochs and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.002)
        process.kill()
        assert process.wait() == -signal.SIGKILL
        assert _epochs_done(tmp_path / part) >= epochs
    train(settings)
    for part in ("teacher/last", "best", "last"):
        ours, theirs = (load_file(folder / part / "model.safetensors") for folder in (tmp_path, output))
        assert all(ours[name].equal(tensor) for name, tensor in theirs.items())


def _epochs_done(checkpoint):
    try:
        return json.loads((checkpoint / "training_state" / "progress.json").read_text())["epoch"]
    except (FileNotFoundError, NotADirectoryError):
        return 0


def test_another_student_is_refused_before_a_teacher_is_trained(run, shapes, tmp_path):
    output, _ = run
    shutil.copytree(output / "last", tmp_path / "last")
    settings = _settings(shapes, tmp_path)
    settings["protocol"]["learning_rate"] = 0.1
    with pytest.raises(ConfigError, match=r"holds a run with protocol\.learning_rate=0\.002, not 0\.1"):
        train(settings)
    assert not (tmp_path / "teacher").exists()


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
    model = build_model("pec2", 64, 4).train()  # prediction is asked for all the same
    points, valid, view = torch.randn(5, 80, 3), torch.rand(5, 80) < 0.8, torch.arange(5) % 4
    checkpoint = Checkpoint(model, list("abcd"), UPRIGHT, 1.0, 1, "pec2")
    sure, soft = (Teacher(checkpoint, temperature).answers(points, valid, view) for temperature in (1.0, 4.0))
    with torch.no_grad():
        logits = model.eval()(UPRIGHT.arrange(points, valid, view))
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
        ({"temperature": float("inf")}, r"protocol\.teacher\.temperature must be positive, got inf"),
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


def test_nearest_neighbours_learn_from_no_answers(shapes, tmp_path):
    with pytest.raises(ConfigError, match=r"protocol\.teacher: model\.name 'knn'"):
        train(_settings(shapes, tmp_path) | {"model": {"name": "knn"}})
