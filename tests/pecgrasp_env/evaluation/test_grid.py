"""A grid of cells: its configurations, its keys, its tables, its page."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from hydra.utils import instantiate
from omegaconf import OmegaConf
from PIL import Image

from grasping import CurvaturePlanner
from pecgrasp_env.common.outcomes import OUTCOME_WORDS, OUTCOMES
from pecgrasp_env.evaluation.episode import Episode
from pecgrasp_env.evaluation.grid import cell_key, read_cells, run_cell
from pecgrasp_env.evaluation.hydra_callback import write_evaluation
from pecgrasp_env.evaluation.page import render
from pecgrasp_env.evaluation.paired_tests import ALL, Comparison, PairingError, compare
from pecgrasp_env.evaluation.run import Protocol, read_episodes
from pecgrasp_env.evaluation.tables import as_results, markdown, read_evaluation

ROOT = Path(__file__).parents[3]
HOSTILE = '</script><b>"it\'s" & co</b><!--'
TABLE = {"title": "A title", "reference": "default", "published": {"theirs": {"can": 90, "mug": 70}}, "notes": ["So."]}


def resolved(*overrides):
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        cfg = compose("evaluate", overrides=list(overrides), return_hydra_config=True)
        HydraConfig.instance().set_config(cfg)
        return OmegaConf.to_container(cfg.copy(), resolve=False), OmegaConf.to_container(
            OmegaConf.masked_copy(cfg, [key for key in cfg if key != "hydra"]), resolve=True
        )


# Configurations


@pytest.mark.parametrize(
    ("overrides", "scene", "n_objects"),
    [
        (["checkpoint=x"], "3 objects, ideal", 3),
        (["checkpoint=x", "env.n_objects=5", "env.clutter=close", "env.sensor=d435"], "5 objects, d435", 5),
        (["checkpoint=x", "experiment=selective"], "3 apart", 3),
        (["checkpoint=x", "experiment=crowded", "crowd=bin"], "12 bin", 12),
        (["experiment=table_5_2", "object=wire_cutter"], "wire_cutter", 1),
    ],
)
def test_a_configuration_says_what_a_cell_is(overrides, scene, n_objects):
    hydra, settings = resolved(*overrides)
    assert (settings["scene"], settings["planner_name"]) == (scene, "default")
    assert settings["env"]["n_objects"] == n_objects
    assert isinstance(instantiate(settings["planner"]), CurvaturePlanner)
    is_grid = any("experiment" in text for text in overrides)
    assert hydra["hydra"]["mode"] == (RunMode.MULTIRUN if is_grid else None)


@pytest.mark.slow
def test_the_hardest_cell_makes_an_environment():
    settings = resolved("experiment=selective", "checkpoint=x", "env.n_objects=8", "env.clutter=close")[1]
    protocol = Protocol(settings["env"], None, settings["planner"], {})
    env = protocol.make_env(obs_mode="state", render_backend="none")
    assert env.unwrapped.layout.n_objects == 8
    assert env.unwrapped.layout.clutter == "close"
    env.close()


def test_only_in_the_bin_is_something_taken_away():
    for crowd, clear in (("touching", False), ("piled", False), ("bin", True)):
        settings = resolved("checkpoint=x", "experiment=crowded", f"crowd={crowd}")[1]
        assert settings["env"]["clutter"] == crowd
        assert (settings["env"]["clear"], settings["policy"]["clear"]) == (clear, clear)


def test_the_grids_are_those_of_the_tables():
    grid = resolved("experiment=table_5_2")[0]["hydra"]["sweeper"]["params"]
    objects, planners = (grid[name].split(",") for name in ("object", "planner"))
    published = resolved("experiment=table_5_2")[1]["table"]["published"]
    assert [sorted(objects)] * 2 == [sorted(figures) for figures in published.values()]
    # The others want something of one's own: meshes, or a trained network.
    complete = {path.stem for path in (ROOT / "conf/planner").glob("*.yaml") if "???" not in path.read_text()}
    assert sorted(planners) == sorted(complete)
    assert sum(published["proposed"].values()) / 6 == pytest.approx(94.17, abs=0.01)
    grid = resolved("experiment=selective", "checkpoint=x")[0]["hydra"]["sweeper"]["params"]
    assert grid == {"env.n_objects": "1,3,5,8", "env.clutter": "apart,close"}


def test_the_key_changes_with_what_decides_an_episode_and_with_nothing_else(tmp_path):
    settings = resolved("experiment=table_5_2")[1]
    key = cell_key(settings)
    beside = {"folder": "elsewhere", "workers": 7, "shard": "0/2", "episodes": 3, "scene": "x", "pictures": False}
    assert cell_key(settings | beside) == key
    assert cell_key(settings | {"first_seed": 5}) != key
    assert cell_key(settings | {"planner": {"_target_": "grasping.CentroidPlanner"}}) != key
    (tmp_path / "config.json").write_text("{}")
    (tmp_path / "model.safetensors").write_bytes(b"weights")
    classifier = cell_key(settings | {"checkpoint": str(tmp_path)})
    assert classifier != key
    (tmp_path / "model.safetensors").write_bytes(b"others")
    assert cell_key(settings | {"checkpoint": str(tmp_path)}) != classifier
    learned = settings | {"planner": {"_target_": "grasping.LearnedPlanner", "scores": {"directory": str(tmp_path)}}}
    trained = cell_key(learned)
    (tmp_path / "model.safetensors").write_bytes(b"trained on")
    assert cell_key(learned) != trained


# A grid without a simulator: its journals are written here.


def episode(seed, outcome, **changes):
    told = {"target": "can", "failures": [], "reason": None, "objects": ["can_1000"], "disturbance_m": 0.001 * seed}
    told |= {"stages": {"segment": [0.01, 0.03], "plan grasp": [0.002]}} | changes
    return Episode(seed, outcome=outcome, steps=70, views=1, confidence=0.9, **told)


def cell(folder, scene, planner, outcomes, wanted=None, first_seed=1, **changes):
    settings = {"scene": scene, "planner_name": planner, "env": {"classes": [scene]}, "planner": {"_target_": planner}}
    settings |= {"policy": {}, "first_seed": first_seed, "checkpoint": None, "folder": str(folder), "pictures": True}
    settings |= {"episodes": wanted or len(outcomes), "workers": 1, "shard": None, "sockets": None}
    directory = folder / "cells" / cell_key(settings)
    directory.mkdir(parents=True)
    lines = [json.dumps(asdict(episode(seed, OUTCOMES[k], **changes))) for seed, k in enumerate(outcomes, first_seed)]
    (directory / "episodes.jsonl").write_text("".join(f"{line}\n" for line in lines))
    if wanted is None:
        return run_cell(settings)
    run_cell(settings | {"episodes": len(outcomes)})
    record = json.loads((directory / "cell.json").read_text())
    record["settings"]["episodes"] = wanted
    (directory / "cell.json").write_text(json.dumps(record))
    return next(known for known in read_cells(folder) if known.key == directory.name)


@pytest.fixture
def grid(tmp_path):
    """can: 8 of 10 against 3 of 10; mug: all of 4, of 6 wanted. 0 success, 1 wrong object, 5 no grasp, 6 missed."""
    cell(tmp_path, "can", "centroid", [0, 0, 6, 6, 6, 6, 6, 6, 5, 0], failures=["closed on nothing"], reason="empty")
    cell(tmp_path, "can", "default", [0, 0, 0, 0, 0, 0, 0, 0, 1, 6])
    cell(tmp_path, "mug", "default", [0, 0, 0, 0], wanted=6)
    return tmp_path


def test_the_table_says_what_the_cells_hold(grid):
    text = markdown(read_evaluation(grid, TABLE))
    lines = text.splitlines()
    assert lines[0] == "# A title"
    assert lines[2] == "| right object lifted | default | centroid | published: theirs |"
    assert lines[4] == "| can | 80.0 (49.0–94.3), n = 10 | 30.0 (10.8–60.3), n = 10 | 90 |"
    assert lines[5] == "| mug | 100.0 (51.0–100.0), n = 4 | – | 70 |"
    assert lines[6] == "| all | 85.7 (60.1–96.0), n = 14 | 30.0 (10.8–60.3), n = 10 | 80 |"
    assert "| can | default | 10 | 80.0 (49.0–94.3) | 10.0 (1.8–40.4) |" in text
    assert "| 0.0 (0.0–27.8) | 80.0 (49.0–94.3) | 5.5 / 9.5 | 70 |" in text  # no error, first try, moved mm, steps
    assert "| 0.0 (0.0–27.8) | 0.0 (0.0–27.8) | 5.5 / 9.5 | 70 |" in text  # of the other no try was the first
    assert "| mug | default | 4 of 6 |" in text
    assert "| can | default | centroid | 2 | 6 | 1 | 1 | +50.0 | 0.12 |" in text
    assert "| can | centroid | 20.0 / 30.0 | 2.0 / 2.0 |" in text
    assert "- can, centroid, gave up: empty × 10" in text
    assert "closed on nothing × 10" in text
    assert text.endswith("So.\n")


def test_successes_are_counted_by_how_much_was_seen(tmp_path):
    cell(tmp_path, "whole", "default", [0, 6], visible_share=0.95)
    assert "by how much" not in markdown(read_evaluation(tmp_path, TABLE))
    hidden = cell(tmp_path, "piled", "default", [0] * 8 + [6] * 3)
    shares = [0.0, 0.05, 0.1, 0.2999, 0.5, 0.55, 0.99, 1.0, 0.0999, 0.5, 0.95]
    noted = [replace(each, visible_share=share) for each, share in zip(hidden.episodes, shares, strict=True)]
    (hidden.folder / "episodes.jsonl").write_text("".join(json.dumps(asdict(each)) + "\n" for each in noted))
    write_evaluation(tmp_path, TABLE, ["python"])
    row = "2 of 3 | 1 of 1 | 1 of 1 | – | – | 2 of 3 | – | – | – | 2 of 3 | 66.7 (30.0–90.3), n = 6"
    assert f"| piled | default | {row} |" in (tmp_path / "table.md").read_text()
    assert all(text in (tmp_path / "report.html").read_text() for text in ("0.5 … 0.6", "66.7 (30.0–90.3), n = 6"))
    results = json.loads((tmp_path / "results.json").read_text())["cells"]
    piled = next(each for each in results if each["scene"] == "piled")
    assert piled["half_visible"]["count"] == 4
    assert piled["by_visible_share"]["0.0"] | {"interval": None} == {
        "n": 3,
        "count": 2,
        "share": 2 / 3,
        "interval": None,
    }


def test_csv_and_results_have_a_row_a_cell(grid):
    write_evaluation(grid, TABLE, ["python"])
    with (grid / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["scene"], row["planner"], row["episodes"], row["wanted"]) for row in rows] == [
        ("can", "default", "10", "10"),
        ("can", "centroid", "10", "10"),
        ("mug", "default", "4", "6"),
    ]
    assert float(rows[0]["success"]) == 0.8
    assert float(rows[0]["success_low"]) == pytest.approx(0.490, abs=1e-3)
    assert json.loads(rows[1]["settings"])["planner"] == {"_target_": "centroid"}
    results = json.loads((grid / "results.json").read_text())
    assert [row["outcomes"]["success"]["count"] for row in results["cells"]] == [8, 3, 4]
    assert results["all_scenes"]["default"]["episodes"] == 14
    assert results["comparisons"][0]["only_first"] == 6
    assert results["comparisons"][0]["p"] == pytest.approx(0.125)
    assert not list(grid.glob("*.tmp"))


def test_planners_are_paired_by_seed_in_each_scene_and_in_all(tmp_path):
    cells = [
        cell(tmp_path, "can", "default", [0, 0, 6, 0]),
        cell(tmp_path, "can", "centroid", [6, 0, 6]),
        cell(tmp_path, "mug", "default", [0, 0]),
        cell(tmp_path, "mug", "centroid", [6, 8]),
    ]
    assert compare(cells, "default") == [
        Comparison("can", "default", "centroid", 1, 1, 0, 1),
        Comparison("mug", "default", "centroid", 0, 2, 0, 0),
        Comparison(ALL, "default", "centroid", 1, 3, 0, 1),
    ]
    assert compare(cells, "geograsp") == []


def test_planners_are_paired_by_their_first_tries_too(tmp_path, outline):
    """One lifts it at once, the other only after a try that failed."""
    cell(tmp_path, "can", "default", [0, 0, 6])
    cell(tmp_path, "can", "centroid", [0, 0, 0], failures=["slipped"])
    evaluation = read_evaluation(tmp_path, TABLE)
    assert evaluation.comparisons == [Comparison("can", "default", "centroid", 2, 0, 1, 0)]
    assert evaluation.first_try_comparisons == [Comparison("can", "default", "centroid", 0, 2, 0, 1)]
    text = markdown(evaluation)
    rows = [line for line in text.splitlines() if line.startswith("| can | 66.7 (20.8–93.9), n = 3 |")]
    assert [row.split(" | ")[2].split(" ")[0] for row in rows] == ["100.0", "0.0"]
    assert "both at the first try" in text
    assert "both at the first try" in outline(render(evaluation)).text
    assert as_results(evaluation)["first_try_comparisons"][0]["only_first"] == 2


def test_cells_of_one_name_but_of_other_seeds_are_not_mixed(tmp_path):
    for first_seed, outcomes in ((1, [0, 0]), (300000, [6, 6])):
        cell(tmp_path, "can", "default", outcomes, first_seed=first_seed)
        cell(tmp_path, "can", "centroid", outcomes, first_seed=first_seed)
    evaluation = read_evaluation(tmp_path, TABLE)
    assert evaluation.scenes == ["can, first_seed=1", "can, first_seed=300000"]
    assert "| can, first seed=300000 | 0.0 (0.0–65.8), n = 2 |" in markdown(evaluation)
    assert [(each.scene, each.n) for each in evaluation.comparisons] == [
        ("can, first_seed=1", 2),
        ("can, first_seed=300000", 2),
    ]
    assert as_results(evaluation)["all_scenes"] == {}
    assert "<b>50.0 %</b>" not in render(evaluation)


def test_scenes_that_differ_are_not_paired(tmp_path):
    cells = [
        cell(tmp_path, "can", "default", [0]),
        cell(tmp_path, "can", "centroid", [0], objects=["can_1001"]),
    ]
    with pytest.raises(PairingError, match=r"can, seed 1: default met \['can_1000'\], centroid \['can_1001'\]"):
        compare(cells, "default")


def test_cells_of_another_code_are_left_out(grid):
    for path in grid.glob("cells/*/cell.json"):
        path.write_text(json.dumps(json.loads(path.read_text()) | {"code": "older"}))
    assert read_cells(grid) == []
    assert as_results(read_evaluation(grid, TABLE))["cells"] == []


def test_a_cell_that_cannot_run_says_why(tmp_path):
    settings = resolved("checkpoint=nowhere", f"folder={tmp_path}", "episodes=1", "workers=1")[1]
    done = run_cell(settings)
    assert done.episodes == []
    assert done.error is not None
    assert "nowhere" in done.error
    text = write_evaluation(tmp_path, TABLE, [])
    assert f"stopped by {done.error}" in text
    assert "0 of 1" in text


# The page


def pictured(grid):
    for known in read_cells(grid):
        for each in known.episodes:
            if each.outcome != "success":
                known.failures.mkdir(exist_ok=True)
                for kind in ("camera", "end"):
                    Image.new("RGB", (64, 36), (200, 40, 40)).save(known.failures / f"{each.seed}.{kind}.webp")
    return read_evaluation(grid, TABLE)


def test_the_page_shows_every_failure_with_its_pictures_and_reason(grid, outline):
    seen = outline(render(pictured(grid), ["python scripts/evaluate_grasp.py"]))
    pictures = [address for address in seen.addresses if address.startswith("data:image/webp;base64,")]
    assert len(pictures) == 2 * 9
    assert set(seen.addresses) - set(pictures) == {"data:,"}
    assert seen.text.count("asked for; on the table: can_1000") == 9
    assert seen.text.count("closed on nothing") == 7
    assert "can, centroid: 6 not held, 1 no grasp found" in seen.text
    assert "85.7 %" in seen.text
    assert "4 of 6" in seen.text


def test_text_from_outside_cannot_break_out_of_the_page(tmp_path, outline):
    cell(tmp_path, HOSTILE, HOSTILE, [6], target=HOSTILE, failures=[HOSTILE], reason=HOSTILE, objects=[HOSTILE])
    seen = outline(render(read_evaluation(tmp_path, TABLE | {"title": HOSTILE, "notes": [HOSTILE]}), [HOSTILE]))
    assert seen.text.count(HOSTILE) >= 10


def test_no_cell_still_makes_a_page(tmp_path, outline):
    assert "No episode was run" in outline(render(read_evaluation(tmp_path, TABLE))).text


@pytest.mark.parametrize(("width", "dark"), [(1000, False), (360, True)])
def test_a_browser_shows_the_page_without_a_word_on_its_console(browse, grid, width, dark):
    page = browse(render(pictured(grid), ["python scripts/evaluate_grasp.py"]), width=width, dark=dark)
    page.run("document.querySelectorAll('details').forEach((each) => { each.open = true })")
    page.run("Promise.all([...document.images].map((each) => { each.loading = 'eager'; return each.decode() }))")
    assert page.run("document.images.length") == 18
    assert page.run("[...document.images].every((each) => each.naturalWidth === 64)")
    assert page.run("document.documentElement.scrollWidth") <= width  # nothing sticks out of a phone's screen
    assert page.console == []


# The command


@pytest.mark.slow
def test_killed_and_started_again_the_command_goes_on_and_shards_join(tmp_path):
    def command(folder, *overrides):
        settings = ["experiment=table_5_2", "object=plug_adapter", "episodes=4", "first_seed=100000"]
        settings += ["progress=false", f"folder={folder}"]
        script = [sys.executable, str(ROOT / "scripts/evaluate_grasp.py"), *settings, *overrides]
        return subprocess.Popen(script, cwd=ROOT, stdout=subprocess.PIPE, text=True)

    def journals(folder):
        return list(folder.glob("cells/*/episodes*.jsonl"))

    killed = tmp_path / "killed"
    first = command(killed, "planner=centroid", "workers=2")
    deadline = time.monotonic() + 300
    while not journals(killed):
        assert first.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    kept = read_episodes(journals(killed)[0].parent)
    assert 1 <= len(kept) < 4
    again = command(killed, "planner=centroid", "workers=2")
    assert "n = 4" in again.communicate()[0]
    shared = tmp_path / "shared"
    shards = command(shared, "planner=centroid", "workers=1", "shard=0/2,1/2", "hydra/launcher=joblib")
    assert "n = 4" in shards.communicate()[0]
    (one,), (other,) = journals(killed), journals(shared)
    assert (one.name, other.name) == ("episodes.jsonl", "episodes.jsonl")
    lines = [[json.loads(line) | {"stages": None} for line in path.read_text().splitlines()] for path in (one, other)]
    assert lines[0] == lines[1]
    assert [line["seed"] for line in lines[0]] == [100000, 100001, 100002, 100003]
    for each in kept:
        assert asdict(each) | {"stages": None} in lines[1]
    assert set(OUTCOME_WORDS) >= {line["outcome"] for line in lines[0]}
