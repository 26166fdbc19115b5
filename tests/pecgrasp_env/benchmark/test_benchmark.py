"""The benchmark: routines take turns, every part reports beside its yardstick, an unknown part is refused."""

from __future__ import annotations

import pytest

from pec.networks.registry import MODELS
from pecgrasp_env.benchmark.run import run_benchmark, side_by_side

SMALL = {"seed": 0, "repeats": 1, "cloud_sizes": [256], "classified_sizes": [300]}


def test_routines_take_turns_and_the_first_turn_does_not_count() -> None:
    calls: list[str] = []
    timings = side_by_side({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, repeats=2)
    assert calls == ["a", "b"] * 3
    assert list(timings) == ["a", "b"]
    assert all(each.wall > 0 and each.cpu >= 0 for each in timings.values())


@pytest.mark.parametrize("part", ["planning", "classification"])
def test_a_part_reports_every_routine_beside_its_yardstick(part: str) -> None:
    lines: list[str] = []
    rows = run_benchmark({**SMALL, "parts": [part]}, lines.append)[part]
    assert [row["name"] for row in rows][:3] == ["k-d tree", "default", "published"]
    assert rows[0]["times_yardstick"] == 1
    assert all(row["wall_ms"] > 0 and row["cpu_ms"] > 0 for row in rows)
    assert all(any(row["name"] in line and row["what"] in line for line in lines) for row in rows)


def test_a_decision_is_timed_with_its_stages() -> None:
    tree, whole, *stages = run_benchmark({**SMALL, "decide_at_most_ms": 15, "parts": ["decision"]}, lambda line: None)[
        "decision"
    ]
    assert (tree["times_yardstick"], whole["at_most_ms"]) == (1, 15)
    assert [row["name"] for row in stages] == ["segment", "classify", "plan grasp", "plan motion"]
    assert all(row["wall_ms"] > 0 and row["cpu_ms"] > 0 for row in (whole, *stages))


def test_classification_is_timed_beside_its_target_and_the_rivals() -> None:
    settings = {**SMALL, "parts": ["classification"], "classify_at_most_ms": {300: 1}}
    rows = run_benchmark(settings, lambda line: None)["classification"]
    ours = ["default", "published", "pec upright", "pec2 upright"]
    rivals = [name for name in MODELS if not name.startswith("pec")]
    assert [row["name"] for row in rows] == ["k-d tree", *ours, *rivals, *ours]
    assert [row["name"] for row in rows if row.get("at_most_ms") == 1] == ours
    assert all("6 clouds at once" in row["what"] for row in rows[-4:])


@pytest.mark.slow
def test_training_is_extrapolated_from_a_few_epochs() -> None:
    lines: list[str] = []
    settings = {**SMALL, "parts": ["training"], "training_epochs": 1, "training_threads": 1, "train_at_most_s": 150}
    floor, *rows = run_benchmark(settings, lines.append)["training"]
    assert floor["times_yardstick"] == 1
    assert [row["name"] for row in rows] == ["float32", "bfloat16"]
    for row in rows:
        assert row["extrapolated_s"] == pytest.approx(0.15 * row["wall_ms"])
        assert row["at_most_ms"] == 1000
    assert sum("150 epochs" in line and "extrapolated" in line for line in lines) == 2


def test_segmentation_is_timed_on_the_wrist_camera_s_frame_beside_its_target() -> None:
    settings = {**SMALL, "parts": ["segmentation"], "resolutions": ["424x240"], "segment_at_most_ms": {"424x240": 10}}
    lines: list[str] = []
    tree, default, published = run_benchmark(settings, lines.append)["segmentation"]
    assert [row["name"] for row in (tree, default, published)] == ["k-d tree of the frame", "default", "published"]
    assert default["objects_found"] == 5
    assert default["at_most_ms"] == 10
    assert any("at most 10 ms" in line for line in lines)
    assert "at_most_ms" not in published


def test_a_part_that_does_not_exist_is_named() -> None:
    with pytest.raises(ValueError, match=r"parts=.*'cooking'.*planning"):
        run_benchmark({**SMALL, "parts": ["cooking"]})
