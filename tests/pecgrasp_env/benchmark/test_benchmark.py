"""The benchmark: routines take turns, every part reports beside its yardstick, an unknown part is refused."""

from __future__ import annotations

import pytest
import torch

from pec.networks.registry import MODELS, build_model
from pec.training.costs import multiply_adds
from pecgrasp_env.benchmark.run import run_benchmark, side_by_side
from pecgrasp_env.benchmark.timing import limited, line_of
from pecgrasp_env.benchmark.training import _shapes

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
    tree, whole, *stages = run_benchmark({**SMALL, "decide_at_most": 1e9, "parts": ["decision"]}, lambda line: None)[
        "decision"
    ]
    assert (tree["times_yardstick"], whole["at_most"], whole["held"]) == (1, 1e9, True)
    assert [row["name"] for row in stages] == ["segment", "classify", "plan grasp", "plan motion"]
    assert all(row["wall_ms"] > 0 and row["cpu_ms"] > 0 for row in (whole, *stages))


def test_classification_is_timed_beside_its_target_and_the_rivals() -> None:
    settings = {**SMALL, "parts": ["classification"], "classify_at_most": {300: 1e-9}}
    rows = run_benchmark(settings, lambda line: None)["classification"]
    ours = ["default", "published", "pec upright", "pec2 upright"]
    rivals = [name for name in MODELS if not name.startswith("pec")]
    assert [row["name"] for row in rows] == ["k-d tree", *ours, *rivals, *ours]
    assert [row["name"] for row in rows if "at_most" in row] == ours
    assert not any(row.get("held") for row in rows)
    assert all("6 clouds at once" in row["what"] for row in rows[-4:])


@pytest.mark.slow
def test_the_way_to_an_arm_is_timed_beside_its_libraries() -> None:
    pytest.importorskip("rtde_control", reason="pip install 'pecgrasp[ur]'")
    pytest.importorskip("pyrealsense2", reason="pip install 'pecgrasp[realsense]'")
    rows = run_benchmark({**SMALL, "repeats": 5, "parts": ["robot"]}, lambda line: None)["robot"]
    assert [row["name"] for row in rows] == [
        *("ur_rtde, its receiver", "URArm.state", "ur_rtde, servoJ", "URArm.follow"),
        *("a bare socket", "RobotiqGripper.width"),
        *("pyrealsense2", "RealSenseCamera, frames=1", "RealSenseCamera, frames=8"),
    ]
    assert [row["times_yardstick"] == 1 for row in rows] == [True, False, True, False, True, False, True, False, False]
    assert all(row["rate"] > 0 and row["unit"] == "Hz" for row in rows)


@pytest.mark.slow
def test_training_is_extrapolated_from_a_few_epochs() -> None:
    lines: list[str] = []
    settings = {**SMALL, "parts": ["training"], "training_epochs": 1, "training_threads": 1, "train_at_most": 1e9}
    floor, own_sizes, *rows = run_benchmark(settings, lines.append)["training"]
    assert floor["times_yardstick"] == 1
    assert own_sizes["name"] == "at the layers' own sizes"
    assert [row["name"] for row in rows][:1] == ["float32"]
    assert [row["name"] for row in rows][1:] in ([], ["bfloat16"])  # where precision=auto takes it
    for row in rows:
        assert row["extrapolated_s"] == pytest.approx(0.15 * row["wall_ms"])
        assert row["held"]
    assert sum("150 epochs" in line and "extrapolated" in line for line in lines) == len(rows)


def test_products_at_the_layers_own_sizes_are_the_multiply_adds_of_the_network() -> None:
    model = build_model("pec", 64, 5).eval()
    products = _shapes(model, torch.zeros(2, 64, 3))
    assert sum(m * k * n for m, k, n in products) == 2 * multiply_adds(model, 64)
    assert (2 * 3, 3 * 256, 512) in products  # the second convolution: three outputs, three taps of 256 channels


def test_a_limit_is_a_multiple_of_the_yardstick_and_is_said_to_be_held_or_not() -> None:
    slow, fast = ({"what": "w", "name": "n", "wall_ms": ms, "cpu_ms": ms, "times_yardstick": 2.0} for ms in (1e6, 1e-6))
    for row in (slow, fast):  # milliseconds decide nothing
        assert limited(row, 2.5)["held"]
        assert not limited(row, 1.5)["held"]
        assert limited(row, None) == row
    assert line_of(limited(slow, 2.5)).endswith("2.00 x   at most 2.5 x: held")
    assert line_of(limited(slow, 1.5)).endswith("2.00 x   at most 1.5 x: NOT HELD")


def test_what_is_not_held_is_listed_with_the_processor() -> None:
    lines: list[str] = []
    settings = {**SMALL, "parts": ["planning"], "plan_at_most": {256: 1e-9}}
    results = run_benchmark(settings, lines.append)
    assert results["limits"] == {
        "held": 0,
        "not_held": ["planning: 256 points, default", "planning: 256 points, default, table unknown"],
    }
    assert results["machine"]["processor"] in lines[0]
    assert any("limits: 0 of 2 held" in line for line in lines)


def test_segmentation_is_timed_on_the_wrist_camera_s_frame_beside_its_target() -> None:
    case = "5 apart 424x240"
    settings = {**SMALL, "parts": ["segmentation"], "segmented": [case], "segment_at_most": {case: 1e9}}
    lines: list[str] = []
    rows = run_benchmark(settings, lines.append)["segmentation"]
    assert [row["name"] for row in rows] == ["k-d tree of the frame", "default", "published"] * 2
    (_, default, published), (_, of_base, _) = rows[:3], rows[3:]
    assert "camera's frame" in default["what"]
    assert "robot's frame" in of_base["what"]
    assert default["objects_found"] == of_base["objects_found"] == 5
    assert default["held"]
    assert "held" not in of_base
    assert any("at most 1e+09 x: held" in line for line in lines)
    assert "at_most" not in published


def test_a_part_that_does_not_exist_is_named() -> None:
    with pytest.raises(ValueError, match=r"parts=.*'cooking'.*planning"):
        run_benchmark({**SMALL, "parts": ["cooking"]})
