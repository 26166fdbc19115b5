"""The report: well-formed, self-contained, honest about intervals and failures, and quiet in a real browser."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from grasping.grasp import Grasp, GraspPlan, RegionReport
from pecgrasp_env.common.outcomes import OUTCOME_WORDS, OUTCOMES
from pecgrasp_env.demo.episode_record import ClassifiedObject, EpisodeRecord, load_record, save_record
from pecgrasp_env.demo.report import ClassifierRecord, ReportRecord, render, stage_times, write_report
from pecgrasp_env.evaluation.episode import Episode

HOSTILE = '</script><b>"it\'s" & co</b><!--'


def cloud(seed: int, n: int = 200) -> np.ndarray:
    points = np.random.default_rng(seed).uniform(-0.05, 0.05, (n, 3)) + np.array([0.5, 0.1 * seed, 0.03])
    return points.astype(np.float32)


def episode(outcome: str = "success", **changes) -> EpisodeRecord:
    points = cloud(1)
    pose = np.diag([1.0, -1, -1, 1])
    pose[:3, 3] = points.mean(axis=0)
    grasp = Grasp(pose, 0.06, 0.8, "region", 0, {"margin": 0.5})
    plan = GraspPlan(grasp, [grasp], [RegionReport(points, "box", 0.06, 0.02, "candidate", 0)], None)
    told = {"target": "plug_adapter", "reason": None, "failures": []}
    told |= {"stages": {"segment": [0.01, 0.03], "plan grasp": [0.002]}, "objects": ["mouse_0003"]}
    told |= {key: changes.pop(key) for key in told if key in changes and key != "objects"}
    ended = Episode(41, outcome=outcome, steps=200, views=1, confidence=0.9, **told)
    seen = (ClassifiedObject(points, "plug_adapter", 0.97, chosen=True), ClassifiedObject(cloud(2), "mouse", 0.88))
    fields = {"objects": seen, "cloud": cloud(3, 500), "plan": plan, "picture": np.full((24, 32, 3), 90, np.uint8)}
    fields |= {"film_second": 62.5}
    return EpisodeRecord(ended, **(fields | changes))


def report(*episodes: EpisodeRecord, **changes) -> ReportRecord:
    confusion = np.array([[9, 1], [0, 10]])
    classifier = ClassifierRecord(["stapler", "mouse"], confusion, {"training": [0.5, 0.9, 1.0]})
    return ReportRecord("Selective grasping", "Three objects.", episodes, **({"classifier": classifier} | changes))


def test_a_full_report_is_well_formed_and_shows_its_numbers(outline) -> None:
    episodes = [episode("success" if k < 9 else "wrong_object") for k in range(1, 11)]
    seen = outline(render(report(*episodes, durations={"training": 75.0}, film="film.mp4", versions={"numpy": "2"})))
    pictures = {address for address in seen.addresses if address.startswith("data:image/jpeg;base64,")}
    links = {"data:,", "film.mp4", "film.mp4#t=62.5", *(f"#episode-{k}" for k in range(1, 11))}
    assert set(seen.addresses) - pictures == links
    assert seen.ids == [f"episode-{k}" for k in range(1, 11)]
    assert "8/10" in seen.text
    assert (
        "80\N{NO-BREAK SPACE}%, 95\N{NO-BREAK SPACE}% interval 49–94\N{NO-BREAK SPACE}%" in seen.text
    )  # Wilson, for 8 of 10
    assert "95.0 %" in seen.text  # 19 of 20 clouds
    assert "1:15 min" in seen.text
    assert "the plug adapter was asked for" in seen.text
    assert len(seen.data) == 10


def test_text_from_outside_cannot_break_out_of_the_page(outline) -> None:
    hostile = episode("missed", target=HOSTILE, failures=[HOSTILE], objects=(ClassifiedObject(cloud(1), HOSTILE, 0.9),))
    classifier = ClassifierRecord([HOSTILE, "mouse"], np.eye(2, dtype=int), {HOSTILE: [0.1, 0.2]}, HOSTILE)
    extra = {
        "configuration": HOSTILE,
        "versions": {HOSTILE: HOSTILE},
        "commands": [HOSTILE],
        "durations": {HOSTILE: 1.0},
    }
    seen = outline(render(ReportRecord(HOSTILE, HOSTILE, [hostile], classifier, **extra)))
    assert seen.text.count(HOSTILE) >= 14
    assert HOSTILE in json.loads(seen.data[0])["layers"][1]["text"][0]


@pytest.mark.parametrize("outcome", [name for name in OUTCOMES if name != "success"])
@pytest.mark.parametrize(
    "changes",
    [
        {
            "plan": None,
            "objects": (),
            "cloud": None,
            "picture": None,
            "stages": {},
            "film_second": None,
            "failures": [],
        },
        {"plan": None, "objects": (), "failures": ["not found", "not found"]},
        {"plan": GraspPlan(None, [], [], "all too wide"), "failures": ["no grasp: all too wide"]},
        {"cloud": np.full((50, 3), np.nan), "plan": None, "objects": ()},
    ],
)
def test_failures_render_with_what_was_tried(outline, outcome: str, changes: dict) -> None:
    record = episode(outcome, reason="gave up", **changes)
    seen = outline(render(report(record)))
    assert OUTCOME_WORDS[outcome][0] in seen.text
    assert all(text in seen.text for text in record.episode.failures)
    assert "0/1" in seen.text


@pytest.mark.parametrize("record", [episode(), episode("no_object", plan=None, objects=(), cloud=None, picture=None)])
def test_a_record_is_the_same_after_a_trip_to_disk(tmp_path: Path, record: EpisodeRecord) -> None:
    save_record(tmp_path / "1.npz", record)
    back = load_record(tmp_path / "1.npz")
    assert render(report(back)) == render(report(record))
    assert back.episode == record.episode
    assert [entry.name for entry in tmp_path.iterdir()] == ["1.npz"]


def test_no_episode_and_no_classifier_still_make_a_report(outline) -> None:
    seen = outline(render(ReportRecord("Nothing yet", "", [])))
    assert "No episode was run" in seen.text
    assert "nan" not in seen.text.lower()


def test_stage_times_are_over_the_calls_of_all_episodes() -> None:
    other = episode(stages={"segment": [0.02], "plan motion": []})
    assert stage_times([episode(), other]) == {"segment": (0.02, 0.03, 3), "plan grasp": (0.002, 0.002, 1)}


def test_a_report_replaces_the_older_one_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text("old")
    write_report(path, report(episode()))
    assert path.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert [entry.name for entry in tmp_path.iterdir()] == ["report.html"]


@pytest.mark.parametrize(("width", "dark"), [(1000, False), (360, True)])
def test_a_browser_shows_the_report_without_a_word_on_its_console(browse, width: int, dark: bool) -> None:
    html = render(report(episode(), episode("missed", reason="slipped"), film="film.mp4", durations={"all": 9.0}))
    page = browse(html, width=width, dark=dark)
    page.run("document.getElementById('episode-2').scrollIntoView()")
    page.wait(10)
    assert page.run("document.querySelectorAll('canvas')[1].width") > 200
    assert page.run("document.documentElement.scrollWidth") <= width  # nothing sticks out of a phone's screen
    assert page.console == []
