"""The benchmark of generation: every case beside its target and the yardstick, the floor, the growth of memory."""

import numpy as np
import pytest

from pecgrasp_env.benchmark.generation import memory_growth
from pecgrasp_env.benchmark.run import run_benchmark


@pytest.mark.slow
def test_generation_is_timed_beside_the_stepped_environment_and_its_floor():
    settings = {
        "parts": ["generation"],
        "seed": 0,
        "clouds": 40,
        "rival_clouds": 2,
        "generation_repeats": 1,
        "workers": [1],
        "generation_cases": ["free d435 424x240"],
        "generate_at_most": {"free d435 424x240": 1e9},
        "memory_frames": 40,
    }
    lines: list[str] = []
    rows = run_benchmark(settings, lines.append)["generation"]
    rasteriser, stepped, ours = rows[:3]
    assert (rasteriser["name"], rasteriser["times_yardstick"]) == ("rasteriser alone", 1)
    assert stepped["name"] == "ManiSkill, a step a cloud"
    assert stepped["what"] == "PickCube-v1 pointcloud 424x240"  # as many pixels as the case
    assert ours["name"] == "1 worker"
    assert ours["rate"] > 0
    assert "at_most" not in ours  # limits are of both cores
    assert ours["times_yardstick"] == pytest.approx(rasteriser["rate"] / ours["rate"])
    shares = {row["name"]: row["wall_ms"] for row in rows if row["what"].endswith("one process")}
    assert set(shares) == {"rasteriser alone", "sensor model", "the rest", "all of it"}
    assert sum(shares.values()) - shares["all of it"] <= 1.001 * shares["all of it"]
    assert rows[-1]["name"] == "memory"
    assert rows[-1]["mb"] > 50
    assert {"growth_first_half_mb", "growth_mb"} <= rows[-1].keys()
    assert all(any(row["name"] in line and row["what"] in line for line in lines) for row in rows)


def test_what_keeps_a_megabyte_a_frame_grows_and_what_keeps_nothing_does_not():
    kept = []

    def leak(first):
        kept.append(np.ones(250_000, np.float32))
        return 1

    row = memory_growth("leak", leak, frames=80)
    assert row["growth_mb"] == pytest.approx(40, abs=10)
    assert row["growth_first_half_mb"] == pytest.approx(40, abs=10)
    assert abs(memory_growth("none", lambda first: 1, frames=80)["growth_mb"]) < 10
