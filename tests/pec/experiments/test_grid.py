"""A grid keeps its cells, says why one failed, and ends in a table that says what was measured."""

import csv
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from statistics import fmean, stdev

import pytest

from pec.experiments.grid import cell_key, read_cells, run_cell
from pec.experiments.grid_table import write_table
from pec.metrics.proportions import wilson_interval

ROOT = Path(__file__).parents[3]


def _settings(shapes, folder, **changes):
    return {
        "dataset": {"path": str(shapes), "samples_per_instance": 10},
        "preprocess": {"n_points": 64, "pose": "given", "ordering": "groups", "group_size": 16}
        | changes.pop("preprocess", {}),
        "model": {"name": "pec"},
        "protocol": {"epochs": 1, "batch_size": 16, "selection": "validation", "learning_rate": 0.002}
        | {"precision": "float32"}
        | changes.pop("protocol", {}),
        "augment": {},
        "seed": 0,
        "progress": False,
        "folder": str(folder),
        "name": "anything",
    } | changes


@pytest.fixture(scope="module")
def grid(shapes, tmp_path_factory):
    """Two seeds of two groupings, one of which fails for one seed, and another learning rate."""
    folder = tmp_path_factory.mktemp("grid")
    for seed in (0, 1):
        run_cell(_settings(shapes, folder, seed=seed))
    run_cell(_settings(shapes, folder, preprocess={"group_size": 4}))
    run_cell(_settings(shapes, folder, preprocess={"group_size": 7}))
    run_cell(_settings(shapes, folder, protocol={"learning_rate": 0.1}))
    return folder


def test_cell_is_run_once(shapes, grid, tmp_path):
    settings = _settings(shapes, grid)
    weights = grid / "cells" / cell_key(settings) / "last" / "model.safetensors"
    before = weights.stat().st_mtime_ns
    cell = run_cell(settings | {"name": "another", "threads": 2, "progress": True})
    assert cell["status"] == "done"
    moved = shutil.copytree(shapes, tmp_path / "moved")
    cell = run_cell(settings | {"dataset": settings["dataset"] | {"path": str(moved)}})
    assert cell["status"] == "done"
    assert weights.stat().st_mtime_ns == before


def test_key_changes_with_what_decides_the_numbers_and_with_nothing_else(shapes, tmp_path):
    settings = _settings(shapes, tmp_path)
    key = cell_key(settings)
    moved = shutil.copytree(shapes, tmp_path / "moved")
    assert cell_key(settings | {"dataset": settings["dataset"] | {"path": str(moved)}}) == key
    assert cell_key(settings | {"folder": "elsewhere", "cache": "somewhere", "device": "cpu"}) == key
    assert cell_key(settings | {"seed": 1}) != key
    assert cell_key(_settings(shapes, tmp_path, protocol={"epochs": 2})) != key
    (moved / "results.json").write_text(json.dumps({"seconds": 3.0}))  # the generating command ran once more
    assert cell_key(settings | {"dataset": settings["dataset"] | {"path": str(moved)}}) == key
    (moved / "splits.json").write_text("{}")
    assert cell_key(settings | {"dataset": settings["dataset"] | {"path": str(moved)}}) != key
    (moved / "splits.json").unlink()
    manifest = json.loads((moved / "manifest.json").read_text())
    (moved / "manifest.json").write_text(json.dumps(manifest | {"seed": 5}))
    assert cell_key(settings | {"dataset": settings["dataset"] | {"path": str(moved)}}) != key


def test_failed_cell_says_why_and_is_tried_again(shapes, tmp_path):
    settings = _settings(tmp_path / "nothing", tmp_path)
    cell = run_cell(settings)
    assert cell["status"] == "failed"
    assert re.match(r"DatasetError: .*nothing.*", cell["error"])
    assert [known["status"] for known in read_cells(tmp_path)] == ["failed"]
    again = run_cell(_settings(shapes, tmp_path, dataset={"path": str(shapes), "samples_per_instance": 10}))
    assert again["status"] == "done"


def test_table_says_what_the_cells_measured(grid):
    markdown = write_table(grid, "A title", [{"points": 64, "group": 16, "accuracy": 99.3}])
    assert (grid / "table.md").read_text() == markdown
    assert markdown.startswith("# A title\n")
    cells = [cell for cell in read_cells(grid) if cell["status"] == "done"]
    pair = [
        cell["results"]["best"]["test_accuracy"]
        for cell in cells
        if cell["settings"]["preprocess"]["group_size"] == 16 and cell["settings"]["protocol"]["learning_rate"] == 0.002
    ]
    assert len(pair) == 2
    row = next(line for line in markdown.splitlines() if "groups of 16" in line and "0.002" in line).split(" | ")
    assert row[:6] == ["pec", "64", "groups of 16", "honest", "1", "2"]
    assert row[6] == f"{100 * fmean(pair):.2f} ± {100 * stdev(pair):.2f}"
    n = cells[0]["results"]["n_samples"]["test"]
    low, high = next(
        line["wilson"] for line in json.loads((grid / "results.json").read_text())["rows"] if len(line["seeds"]) == 2
    )
    for end in (low, high):  # where Wilson's interval ends the mean is 1.96 standard errors away
        assert (fmean(pair) - end) ** 2 == pytest.approx(1.959964**2 * end * (1 - end) / n)
    assert low <= fmean(pair) <= high
    assert low < high
    assert row[7] == f"{100 * low:.1f}–{100 * high:.1f}"
    assert row[10] == "99.3"
    assert row[-1] == "protocol.learning_rate=0.002"
    assert "groups of 7, honest, seed 0: ConfigError: preprocess.group_size 7 does not divide" in markdown


def test_table_says_where_training_was_not_in_float32(shapes, grid, tmp_path):
    assert "precision" not in write_table(grid, "A title", [])
    run_cell(_settings(shapes, tmp_path))
    run_cell(_settings(shapes, tmp_path, protocol={"precision": "bfloat16"}))
    head, _, *lines = write_table(tmp_path, "A title", []).splitlines()[2:6]
    place = head.split(" | ").index("precision")
    assert sorted(line.split(" | ")[place] for line in lines) == ["bfloat16", "float32"]
    assert "protocol.precision" not in head
    with (tmp_path / "table.csv").open(newline="") as file:
        assert sorted(line["precision"] for line in csv.DictReader(file)) == ["bfloat16", "float32"]


def test_recipes_that_name_other_settings_stand_side_by_side(shapes, tmp_path):
    run_cell(_settings(shapes, tmp_path))
    run_cell(_settings(shapes, tmp_path, preprocess={"size": "root"}))
    run_cell(_settings(shapes, tmp_path, preprocess={"size": "root"}, protocol={"initial_weights": "scaled"}))
    published = [{"points": 64, "group": 16, "accuracy": 99.3}]
    head, _, *lines = write_table(tmp_path, "A title", published).splitlines()[2:7]
    rows = {(row[2], row[-1]): row for row in (line.split(" | ") for line in lines)}
    assert set(rows) == {
        ("groups of 16", ""),
        ("groups of 16, root size", ""),
        ("groups of 16, root size", "protocol.initial_weights=scaled"),
    }
    place = head.split(" | ").index("published %")
    # The dissertation's figure is of clouds in metres.
    assert [row[place] for _, row in sorted(rows.items())] == ["99.3", "–", "–"]
    svg = (tmp_path / "accuracy_by_latency.svg").read_text()
    assert "groups of 16, root size, honest, protocol.initial_weights=scaled" in svg


def test_csv_and_json_have_a_line_a_cell(grid):
    write_table(grid, "A title", [{"points": 64, "group": 4, "accuracy": 93}])
    with (grid / "table.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert sorted(int(line["seed"]) for line in lines) == [0, 0, 0, 1]
    assert {line["published"] for line in lines if line["order"] == "groups of 4"} == {"0.93"}
    for line in lines:
        n, share = int(line["n_test"]), float(line["test_accuracy"])
        assert float(line["wilson_low"]) == pytest.approx(wilson_interval(round(n * share), n)[0])
        assert json.loads(line["settings"])["protocol"]["epochs"] == int(line["epochs"]) == 1
    rows = json.loads((grid / "results.json").read_text())["rows"]
    assert sum(len(row["seeds"]) for row in rows) == len(lines)
    assert [len(row["missing"]) for row in rows if row["settings"]["preprocess"]["group_size"] == 7] == [1]


def test_plots_are_drawn_where_there_is_something_to_compare(grid):
    write_table(grid, "A title", [{"points": 64, "group": None, "accuracy": 80}])
    names = {path.stem for path in grid.glob("*.svg")}
    curves = {"learning_curves_selection_accuracy", "learning_curves_train_loss"}
    assert names == {"accuracy_by_group_size", "accuracy_by_latency"} | curves
    assert {path.stem for path in grid.glob("*.png")} == names
    text = (grid / "accuracy_by_group_size.svg").read_text()
    assert "dissertation, 64 points" in text


def test_table_of_another_code_is_empty(grid, tmp_path):
    folder = shutil.copytree(grid, tmp_path / "grid")
    for path in folder.glob("cells/*/cell.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"code": "older"}))
    assert read_cells(folder) == []
    assert "pec" not in write_table(folder, "A title", []).replace("A title", "").splitlines()[4]


def test_hydra_launches_the_grid(tmp_path, shapes):
    launch(tmp_path, shapes, "basic", "0,1")


@pytest.mark.slow
def test_jobs_find_the_cells_of_those_before_done(tmp_path, shapes):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher")
    launch(tmp_path, shapes, "joblib", "0,1", "hydra.launcher.n_jobs=2")
    launch(tmp_path, shapes, "submitit_local", "1,2")


def launch(place, shapes, launcher, seeds, *options):
    folder = place / "outputs/ablate/table_4_2"  # where the command puts it that says nothing of it
    before = {path: path.stat().st_mtime_ns for path in folder.glob("cells/*/last/model.safetensors")}
    command = [sys.executable, str(ROOT / "scripts" / "ablate.py"), "experiment=table_4_2"]
    command += [f"dataset.path={shapes}", "dataset.samples_per_instance=10", "protocol=published", "protocol.epochs=1"]
    command += ["preprocess=none", f"seed={seeds}", "cache=null", "progress=false", f"hydra/launcher={launcher}"]
    done = subprocess.run([*command, *options], cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    cells = [json.loads(path.read_text()) for path in folder.glob("cells/*/cell.json")]
    seen = {cell["settings"]["seed"] for cell in cells if cell["status"] == "done"}
    assert seen == set(range(int(seeds[-1]) + 1))
    assert all(path.stat().st_mtime_ns == time for path, time in before.items())
    row = next(line for line in done.stdout.splitlines() if line.startswith("pec |")).split(" | ")
    assert row[:6] == ["pec", "64", "no grouping", "published", "1", str(len(seen))]
    assert row[10] == "83.9"
