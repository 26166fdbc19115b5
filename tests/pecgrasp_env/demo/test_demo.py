"""The demo, small: everything is made, and a second run makes nothing again."""

from __future__ import annotations

import json
from pathlib import Path

import imageio_ffmpeg
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from pecgrasp_env.demo.run import run_demo

CONF = Path(__file__).parents[3] / "conf"


@pytest.mark.slow
def test_a_small_demo_leaves_report_film_and_results_and_a_second_run_makes_nothing_again(tmp_path, outline) -> None:
    small = ["generation.instances_per_class=1", "generation.samples_per_instance=30", "generation.tabletop.drops=8"]
    small += ["training.protocol.epochs=2", "episodes=2", f"out={tmp_path}", "film.width=320", "film.height=240"]
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = OmegaConf.to_container(compose("demo", [*small]), resolve=True)
    told: list[str] = []
    results = run_demo(cfg, say=told.append)
    assert json.loads((tmp_path / "results.json").read_text())["episodes"] == results["episodes"]
    assert len(outline((tmp_path / "report.html").read_text(encoding="utf-8")).data) == 2  # figures
    length = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "video.mp4"))[1]
    assert length > sum(episode["steps"] for episode in results["episodes"]) / 20  # 20 steps a second, and the endings
    assert any("150 clouds, 150 of them new" in line for line in told)

    made = {path: path.stat().st_mtime_ns for path in (tmp_path / "work").rglob("*.npz")}
    told.clear()
    again = run_demo(cfg, say=told.append)
    assert again["episodes"] == results["episodes"]
    assert again["durations_s"] == results["durations_s"]
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "work").rglob("*.npz")} == made
    assert any("150 clouds, 0 of them new" in line for line in told)
    assert any("there already" in line for line in told)
