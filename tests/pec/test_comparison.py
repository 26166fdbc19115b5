"""Classifiers are compared cloud by cloud on one test split, and what all of them miss is named."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pec.comparison import compare_classifiers, comparison_table
from pec.errors import ConfigError, DatasetError
from pec.proportions import mcnemar, wilson_interval
from pec.training import train

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def runs(shapes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared")
    other = shutil.copytree(shapes, folder / "other")
    manifest = json.loads((other / "manifest.json").read_text())
    (other / "manifest.json").write_text(json.dumps(manifest | {"seed": 1}))
    for name, model, data, epochs in (
        ("knn", "knn", shapes, 1),
        ("hasty", "pec", shapes, 1),
        ("trained", "pec", shapes, 12),
        ("elsewhere", "knn", other, 1),
    ):
        settings = {"dataset": {"path": str(data)}, "augment": {}, "model": {"name": model}, "progress": False}
        settings |= {"protocol": {"epochs": epochs, "batch_size": 16}, "output": str(folder / name)}
        train(settings)
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
    assert [(Path(pair["first"]).name, Path(pair["second"]).name) for pair in comparison["pairs"]] == [
        ("knn", "hasty"),
        ("knn", "trained"),
        ("hasty", "trained"),
    ]
    for pair, (first, second) in zip(comparison["pairs"], ((0, 1), (0, 2), (1, 2)), strict=True):
        assert pair["only_first"] - pair["only_second"] == counts[first] - counts[second]
        assert pair["p"] == mcnemar(pair["only_first"], pair["only_second"])


def test_missed_clouds_are_those_that_half_of_the_runs_get_wrong(runs):
    alone = compare_classifiers([runs / "hasty"])
    n_wrong = round((1 - alone["runs"][0]["accuracy"]) * alone["n_test"])
    assert n_wrong > 0
    assert len(alone["missed"]) == n_wrong
    assert alone["together"] == pytest.approx(alone["runs"][0]["accuracy"])
    assert all(cloud["taken_for"] != cloud["class"] and cloud["missed_by"] == 1 for cloud in alone["missed"])

    three = compare_classifiers([runs / "hasty", runs / "hasty", runs / "knn"])
    assert {cloud["cloud"] for cloud in three["missed"]} == {cloud["cloud"] for cloud in alone["missed"]}
    assert [cloud["missed_by"] for cloud in three["missed"]] == sorted(
        (cloud["missed_by"] for cloud in three["missed"]), reverse=True
    )


def test_runs_of_other_clouds_are_not_compared(runs, shapes, tmp_path):
    with pytest.raises(DatasetError, match=r"elsewhere was tested on other clouds than .*knn"):
        compare_classifiers([runs / "knn", runs / "elsewhere"])
    moved = shutil.copytree(shapes, tmp_path / "moved")
    assert compare_classifiers([runs / "knn"], data=str(moved)) == compare_classifiers([runs / "knn"])
    with pytest.raises(ConfigError, match="runs names no folder"):
        compare_classifiers([])


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
    assert f"{len(missed)} are missed by half of them or more" in done.stdout
    by_class = [line for line in lines if line.count(" | ") == 3][2:]
    assert sum(int(line.split(" | ")[1]) for line in by_class) == len(missed)
