"""Every command, once, on as little as it takes: what it prints and leaves."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pecgrasp.cli import main

TWO_CLASSES = ["objects.classes=[can,plug_adapter]", "instances_per_class=3", "samples_per_instance=20"]
ALONE = ["env.n_objects=1", "env.classes=[plug_adapter]", "workers=1", "progress=false"]


def run(command: str, *overrides: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["pecgrasp", command, *overrides])
        main()


def results(folder: Path) -> dict[str, Any]:
    return json.loads((folder / "results.json").read_text())


def box(centre: tuple[float, float, float], size: tuple[float, float, float], step: float = 0.003) -> np.ndarray:
    """The surface (N, 3) of a box on a grid of points, m."""
    axes = [np.arange(-length / 2, length / 2 + step / 2, step) for length in size]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    on = np.any([np.isclose(np.abs(points[:, k]), axes[k].max(), atol=step / 4) for k in range(3)], axis=0)
    return (points[on] + centre).astype(np.float32)


@pytest.fixture(scope="module")
def frame(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two boxes on a table, seen from the world's origin above it."""
    xy = np.stack(np.meshgrid(*2 * [np.arange(-0.3, 0.3, 0.004)]), axis=-1).reshape(-1, 2)
    table = np.column_stack([xy, np.full(len(xy), -0.5)]).astype(np.float32)
    path = tmp_path_factory.mktemp("frame") / "two boxes (1).npy"
    np.save(
        path, np.vstack([table, box((0.1, 0, -0.47), (0.05, 0.05, 0.06)), box((-0.1, 0, -0.48), (0.04, 0.1, 0.04))])
    )
    return path


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "set"
    run("generate", *TWO_CLASSES, "scenario=surface", "sensor=ideal", "workers=1", "progress=false", f"out={out}")
    return out


@pytest.fixture(scope="module")
def trained(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trained")
    settings = ["protocol.epochs=1", "progress=false", f"cache={out}/cache", f"output={out}/run"]
    run("train", f"dataset.path={data}", *settings)
    return out / "run"


def test_segment_leaves_a_file_an_object_and_removes_those_of_the_last_time(frame, tmp_path, capsys):
    (tmp_path / "object_9.npy").touch()
    run("segment", str(frame), "frame=world", f"output={tmp_path}")
    found = results(tmp_path)
    assert [each["file"] for each in found["objects"]] == ["object_1.npy", "object_2.npy"]
    assert sorted(path.name for path in tmp_path.glob("*.npy")) == ["object_1.npy", "object_2.npy"]
    for each in found["objects"]:
        points = np.load(tmp_path / each["file"])
        assert (points.dtype, points.shape) == (np.float32, (each["points"], 3))
        np.testing.assert_allclose(each["size"], np.ptp(points, axis=0), atol=1e-6)
        assert abs(each["centre"][0]) == pytest.approx(0.1, abs=0.005)
    np.testing.assert_allclose(found["table"], [0, 0, 1, 0.5], atol=1e-3)
    assert "2 objects" in capsys.readouterr().out


def test_segment_names_a_file_that_is_not_there(tmp_path):
    with pytest.raises(SystemExit, match=r"pecgrasp segment: cloud .*nowhere\.ply does not exist"):
        run("segment", f"{tmp_path}/nowhere.ply", f"output={tmp_path}")


def test_plan_takes_what_segment_leaves(frame, tmp_path, capsys):
    run("segment", str(frame), "frame=world", f"output={tmp_path}")
    run("plan", str(tmp_path / "object_1.npy"), "frame=world", f"output={tmp_path}/plan")
    assert results(tmp_path / "plan")["summary"] == {"files": 1, "failed": 0, "objects": 1, "with_grasp": 1}
    assert "plan.html" in capsys.readouterr().out


def test_generate_leaves_a_data_set_and_its_card(data):
    assert results(data)["new_clouds"] == 120
    assert {"manifest.json", "splits.json"} <= {path.name for path in data.iterdir()}
    assert list(data.glob("card*"))


def test_train_leaves_a_checkpoint_and_classify_takes_it(trained, frame, tmp_path, capsys):
    assert {"best", "last", "checkpoint"} <= set(results(trained))
    np.save(tmp_path / "box.npy", box((0, 0, 0), (0.05, 0.05, 0.05)))
    checkpoint = results(trained)["checkpoint"]
    run("classify", f"{tmp_path}/box.npy", f"checkpoint={checkpoint}", f"output={tmp_path}/out")
    answer = results(tmp_path / "out")
    assert set(answer["probabilities"]) == {"can", "plug_adapter"}
    assert answer["confidence"] == max(answer["probabilities"].values())
    assert answer["label"] in capsys.readouterr().out


@pytest.mark.parametrize("command", ["robustness", "compare"])
def test_trained_classifiers_are_measured(command, trained, data, tmp_path, capsys):
    run(command, f"runs=[{trained}]", f"data={data}", "progress=false", f"output={tmp_path}")
    assert (tmp_path / "table.md").read_text() in capsys.readouterr().out
    assert results(tmp_path)


def test_a_checkpoint_is_exported(trained, tmp_path, capsys):
    pytest.importorskip("onnxscript")
    run("export-onnx", f"checkpoint={results(trained)['checkpoint']}", f"output={tmp_path}")
    assert (tmp_path / "model.onnx").stat().st_size == results(tmp_path)["bytes"]


@pytest.mark.slow
def test_ablate_trains_its_grid_and_prints_one_table(data, tmp_path, capsys):
    grid = ["experiment=learning_rates", "protocol.learning_rate=0.01,0.001", "protocol.epochs=1"]
    run("ablate", *grid, f"dataset.path={data}", f"folder={tmp_path}", f"cache={tmp_path}/cache", "progress=false")
    printed = capsys.readouterr().out
    assert printed.count("cell ") >= 2
    assert "learning rates" in printed
    assert list(tmp_path.glob("*.md"))


@pytest.mark.slow
def test_a_contact_sheet_is_an_image_of_the_asked_for_size(tmp_path):
    image = pytest.importorskip("PIL.Image")
    run("contact-sheet", "objects.classes=[can]", "instances=2", "size=32", f"out={tmp_path}/sheet.png")
    assert image.open(tmp_path / "sheet.png").width >= 64


@pytest.mark.slow
def test_published_figures_are_counted(tmp_path):
    run("published-figures", "instances=1", "~planners.published", "~planners.release", f"output={tmp_path}")
    assert results(tmp_path)


@pytest.mark.slow
def test_benchmark_measures_the_part_that_is_asked_for(tmp_path):
    small = ["cloud_sizes=[256]", "repeats=1", "start_repeats=1", "plan_at_most={256:1000}"]
    run("benchmark", "parts=[planning]", *small, f"output={tmp_path}")
    assert results(tmp_path)["planning"]


@pytest.mark.slow
def test_evaluate_asks_for_a_classifier_in_one_line(tmp_path):
    with pytest.raises(SystemExit, match=r"^pecgrasp evaluate: checkpoint=… must be given"):
        run("evaluate", *ALONE, f"folder={tmp_path}")


def test_evaluate_of_a_class_that_there_is_not_fails_and_says_so(tmp_path, capsys):
    with pytest.raises(SystemExit, match="pecgrasp evaluate: 1 cell stopped by an error"):
        run("evaluate", *ALONE, "env.classes=[nonesuch]", "checkpoint=null", "episodes=1", f"folder={tmp_path}")
    assert "unknown object class 'nonesuch'" in capsys.readouterr().out
    assert "nonesuch" in results(tmp_path)["cells"][0]["error"]


@pytest.mark.usefixtures("renderer")
def test_evaluate_plays_an_episode_and_leaves_its_report(tmp_path, capsys):
    run("evaluate", *ALONE, "checkpoint=null", "episodes=1", "planner=centroid", f"folder={tmp_path}")
    assert "1 of 1 episodes" in capsys.readouterr().out
    assert (tmp_path / "report.html").exists()


@pytest.mark.slow
def test_demonstrations_are_recorded(tmp_path, capsys):
    run("record-demos", *ALONE, "episodes=1", "keep=all", f"out={tmp_path}")
    assert (tmp_path / "trajectory.h5").exists()
    assert "1 kept" in capsys.readouterr().out


@pytest.mark.slow
def test_an_agent_is_trained_from_demonstrations(tmp_path, capsys):
    run("record-demos", *ALONE, "episodes=2", "keep=all", f"out={tmp_path}/demos")
    small = ["epochs=1", "copies=1", "width=8", "episodes=1", "final_episodes=1", "most_steps=2", "held_out=0.5"]
    run("train-bc", f"demos={tmp_path}/demos/trajectory.h5", *small, f"out={tmp_path}/bc")
    assert "1 demonstrations" in capsys.readouterr().out  # the other is held out


@pytest.mark.slow
def test_transfer_trains_its_recipes_and_tests_them_on_the_robots_clouds(tmp_path, capsys):
    small = ["scenes.scenes=8", "generation.instances_per_class=2", "workers=1", "seeds=[0]", "scenarios=[free]"]
    small += ["generation.samples_per_instance=12", "training.protocol.epochs=1", "training.progress=false"]
    run("transfer", *small, "~models.pec2", "sensors=[d435]", "~augments.none", f"out={tmp_path}")
    assert "best first" in capsys.readouterr().out
    assert len(results(tmp_path)["recipes"]) == 1


@pytest.mark.slow
def test_the_demo_leaves_its_report_and_names_the_command(tmp_path):
    small = ["generation.instances_per_class=1", "generation.samples_per_instance=30", "generation.tabletop.drops=8"]
    small += ["training.protocol.epochs=2", "episodes=1", "film.width=320", "film.height=240"]
    run("demo", *small, f"out={tmp_path}")
    assert len(results(tmp_path)["episodes"]) == 1
    assert "pecgrasp demo generation.instances_per_class=1" in (tmp_path / "report.html").read_text()


def test_doctor_reports_the_packages_and_ends_by_whether_it_draws(capsys):
    with pytest.raises(SystemExit) as ended:
        run("doctor")
    assert ended.value.code in (0, 1)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[:6]] == ["Python", "Packages", "Grasping", "Drivers", "GPU", "Renders"]


def test_doctor_knows_no_other_word(capsys) -> None:
    with pytest.raises(SystemExit) as ended:
        run("doctor", "--loud")
    assert ended.value.code == 2
    assert "there is only --quiet" in capsys.readouterr().err
