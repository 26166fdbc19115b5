"""Classifiers are compared cloud by cloud on one test split, and what all of them miss is named."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pec import Classifier
from pec.data.loading import load_dataset
from pec.errors import ConfigError, DatasetError
from pec.experiments.comparison import compare_classifiers, comparison_table
from pec.metrics.proportions import mcnemar, wilson_interval
from pec.training.finished_runs import read_finished
from pec.training.loop import train

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def runs(shapes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    shutil.copytree(shapes, folder / "other")
    manifest = json.loads((folder / "other" / "manifest.json").read_text())
    (folder / "other" / "manifest.json").write_text(json.dumps(manifest | {"seed": 1}))
    for name, model, epochs, dataset, selection in (
        ("knn", "knn", 1, {}, "validation"),
        ("hasty", "pec", 1, {}, "validation"),
        ("trained", "pec", 12, {}, "evaluation split"),
        ("elsewhere", "knn", 1, {"path": str(folder / "other")}, "validation"),
        ("damaged", "knn", 1, {"removed": 0.4}, "validation"),
        ("two_classes", "pec", 1, {"classes": ["plate", "rod"]}, "validation"),
    ):
        settings = {"dataset": {"path": str(shapes)} | dataset, "augment": {}, "model": {"name": model}}
        # Networks alone: with the witness of forms even the hasty one misses nothing.
        protocol = {"epochs": epochs, "batch_size": 16, "selection": selection, "surface_forms": False}
        settings |= {"protocol": protocol, "progress": False}
        if name == "two_classes":  # one that learns nothing, so that it misses something
            settings["protocol"]["learning_rate"] = 1e-9
        train(settings | {"output": str(folder / name)})
    return folder


def test_accuracies_are_those_of_the_runs_and_pairs_add_up(runs):
    names = ["knn", "hasty", "trained"]
    comparison = compare_classifiers([runs / name for name in names])
    counts = []
    for name, row in zip(names, comparison["runs"], strict=True):
        reported = json.loads((runs / name / "results.json").read_text())["best"]["test_accuracy"]
        assert row["accuracy"] == pytest.approx(reported)
        counts.append(round(reported * comparison["n_test"]))
        assert row["interval"] == list(wilson_interval(counts[-1], comparison["n_test"]))
    assert counts[1] < counts[2]
    costs = [json.loads((runs / name / "results.json").read_text())["costs"] for name in names]
    for row, cost in zip(comparison["runs"], costs, strict=True):
        assert (row["parameters"], row["multiply_adds"]) == (cost["parameters"], cost["multiply_adds"])
        assert 0 < row["network_ms"] < row["raw_cloud_ms"]
    assert [row["protocol"] for row in comparison["runs"]] == ["honest", "honest", "published"]
    assert comparison["n_objects"] == 6
    assert [(Path(pair["first"]).name, Path(pair["second"]).name) for pair in comparison["pairs"]] == [
        ("knn", "hasty"),
        ("knn", "trained"),
        ("hasty", "trained"),
    ]
    for pair, (first, second) in zip(comparison["pairs"], ((0, 1), (0, 2), (1, 2)), strict=True):
        assert pair["only_first"] - pair["only_second"] == counts[first] - counts[second]
        assert pair["p"] == mcnemar(pair["only_first"], pair["only_second"])


def test_together_they_answer_by_the_mean_of_what_they_would_answer_alone(runs, shapes):
    names = ["hasty", "trained"]
    test, dataset = read_finished(runs / "hasty").test, load_dataset(shapes)
    clouds = [dataset.cloud(place) for place in test.stored]
    of_runs = [Classifier.load(runs / name / "best").predict(clouds) for name in names]
    answers = np.array([[list(answer.probabilities.values()) for answer in predictions] for predictions in of_runs])
    comparison = compare_classifiers([runs / name for name in names])
    expected = (answers.mean(axis=0).argmax(axis=1) == test.labels).mean()
    assert comparison["together"] == pytest.approx(expected)

    # Of two runs, half is one.
    taken_for = answers.argmax(axis=2)
    wrong = (taken_for != test.labels).sum(axis=0)
    assert {(cloud["cloud"], cloud["missed_by"]) for cloud in comparison["missed"]} == {
        (place, n) for place, n in zip(test.stored, wrong, strict=True) if n
    }
    assert 1 in wrong
    for cloud in comparison["missed"]:
        answered = taken_for[:, test.stored.tolist().index(cloud["cloud"])]
        assert cloud["taken_for"] in {test.classes[label] for label in answered} - {cloud["class"]}
        assert cloud["class"] == dataset.classes[dataset.labels[cloud["cloud"]]]


def test_most_missed_come_first_and_a_minority_does_not_count(runs):
    alone = {cloud["cloud"] for cloud in compare_classifiers([runs / "hasty"])["missed"]}
    three = compare_classifiers([runs / "hasty", runs / "hasty", runs / "knn"])["missed"]
    assert {cloud["cloud"] for cloud in three} == alone
    assert [cloud["missed_by"] for cloud in three] == sorted((cloud["missed_by"] for cloud in three), reverse=True)
    minority = compare_classifiers([runs / "hasty", runs / "knn", runs / "knn"])["missed"]
    assert {cloud["cloud"] for cloud in minority} == {
        cloud["cloud"] for cloud in compare_classifiers([runs / "knn"])["missed"]
    }


def test_clouds_are_named_by_their_place_in_the_stored_set(runs, shapes):
    dataset = load_dataset(shapes)
    missed = compare_classifiers([runs / "two_classes"])["missed"]
    assert missed
    assert all(dataset.classes[dataset.labels[cloud["cloud"]]] == cloud["class"] for cloud in missed)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("elsewhere", r"elsewhere was tested on other clouds than .*knn"),
        ("damaged", r"damaged has another dataset\.removed than .*knn"),
        ("two_classes", r"two_classes knows other classes than .*knn"),
    ],
)
def test_runs_of_other_clouds_are_not_compared(name, message, runs):
    with pytest.raises(DatasetError, match=message):
        compare_classifiers([runs / "knn", runs / name])


def test_runs_know_their_data_wherever_they_lie(runs, shapes, tmp_path):
    moved = shutil.copytree(shapes, tmp_path / "moved")
    comparisons = [compare_classifiers([runs / "knn"], data=data) for data in (str(moved), None)]
    for comparison in comparisons:
        del comparison["runs"][0]["network_ms"], comparison["runs"][0]["raw_cloud_ms"]
    assert comparisons[0] == comparisons[1]
    with pytest.raises(DatasetError, match=r"knn was trained on other data than .*other holds now"):
        compare_classifiers([runs / "knn"], data=str(runs / "other"))
    with pytest.raises(ConfigError, match="runs names no folder"):
        compare_classifiers([])


@pytest.mark.slow
def test_script_prints_the_table_and_leaves_the_numbers(runs, tmp_path):
    command = [sys.executable, str(ROOT / "scripts" / "compare_classifiers.py"), f"output={tmp_path}", "progress=false"]
    done = subprocess.run(
        [*command, f"runs=[{runs / 'trained'},{runs / 'hasty'}]"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    comparison = json.loads((tmp_path / "results.json").read_text())
    assert (tmp_path / "table.md").read_text() == comparison_table(comparison)
    assert (tmp_path / "table.md").read_text() in done.stdout
    pair = comparison["pairs"][0]
    lines = done.stdout.splitlines()
    assert lines[2].endswith("– | – | –")
    assert lines[3].endswith(f"{pair['only_second']} | {pair['only_first']} | {pair['p']:.3g}")
    missed = comparison["missed"]
    assert f"{len(missed)} clouds are missed by half of the runs or more" in done.stdout
    by_class = [line for line in lines if line.count(" | ") == 3][2:]
    assert sum(int(line.split(" | ")[1]) for line in by_class) == len(missed)
