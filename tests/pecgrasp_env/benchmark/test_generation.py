"""The benchmark of generation: every case beside its target and the yardstick, the floor, the growth of memory."""

import pytest

from pecgrasp_env.benchmark.run import run_benchmark


def test_generation_is_timed_beside_the_stepped_environment_and_its_floor():
    settings = {
        "parts": ["generation"],
        "seed": 0,
        "clouds": 40,
        "rival_clouds": 2,
        "generation_repeats": 1,
        "workers": [1],
        "generation_cases": ["free d435 424x240"],
        "generate_at_least": {"free d435 424x240": 150},
        "memory_frames": 40,
    }
    told: list[str] = []
    rows = run_benchmark(settings, told.append)["generation"]
    assert rows[0]["name"] == "1 worker"
    assert rows[0]["rate"] > 0
    assert "at_least" not in rows[0]  # targets are of both cores
    assert rows[1]["name"] == "ManiSkill, a step a cloud"
    assert rows[1]["what"] == "PickCube-v1 pointcloud 424x240"  # as many pixels as the case
    assert rows[1]["times_yardstick"] == 1
    assert rows[0]["times_yardstick"] == pytest.approx(rows[1]["rate"] / rows[0]["rate"])
    shares = {row["name"]: row["wall_ms"] for row in rows if row["what"].endswith("one process")}
    assert set(shares) == {"rasteriser alone (the floor)", "sensor model", "the rest", "all of it"}
    assert sum(shares.values()) - shares["all of it"] <= 1.001 * shares["all of it"]
    assert rows[-1]["name"] == "memory"
    assert rows[-1]["mb"] > 50
    assert abs(rows[-1]["growth_mb"]) < rows[-1]["mb"]
    assert all(any(row["name"] in line and row["what"] in line for line in told) for row in rows)
