"""What a scene leaves out is said on the console, on the page and in the results, with what to type to have it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from grasping_shapes import box_top, moved
from hydra import compose, initialize_config_dir
from table_scenes import box, on_a_table, table_scene, task

from grasping import CloudError, Segmenter, SelectiveGrasper
from grasping.plan_files.run import plan_files
from pecgrasp.commands.plan import task_of

ROOT = Path(__file__).parents[3]


def said_of(tmp_path: Path, cloud: np.ndarray, **how: object) -> list[str]:
    """The lines below the file's row; they must stand on the page, too."""
    np.save(tmp_path / "cloud.npy", cloud)
    said: list[str] = []
    plan_files(
        [tmp_path / "cloud.npy"], task(**{"segmenter": Segmenter(), "up": None} | how), tmp_path, say=said.append
    )
    lines = [line.strip() for line in said if line.startswith("  ") and not line.startswith("  object")]
    page = (tmp_path / "plan.html").read_text().replace("&#39;", "'")
    assert all(line in page for line in lines)
    return lines


def again(tmp_path: Path, lines: list[str], start: str) -> int:
    """How many objects there are once what the line says is typed."""
    (line,) = [each for each in lines if each.startswith("left out") and start in each]
    setting = shlex.split(line.split("; ")[-1])[0]
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        cfg = compose("plan", overrides=["cloud=x.npy", "scene=true", setting])
    return plan_files([tmp_path / "cloud.npy"], task_of(cfg), tmp_path, say=lambda line: None)["summary"]["objects"]


def test_what_is_too_large_is_taken_with_the_setting_that_is_said(tmp_path: Path) -> None:
    lines = said_of(tmp_path, on_a_table(moved(box(), y=0.15), moved(box_top(0.52, 0.06, 0.08), y=-0.1)))
    assert any("0.52 m large, more than 0.45 m; +segmenter.max_extent=0.55 takes them" in line for line in lines)
    assert again(tmp_path, lines, "m large") == 2
    (file,) = json.loads((tmp_path / "results.json").read_text())["files"]
    assert not any(each["way_out"].startswith("max_extent") for each in file["rejected"])


def test_what_is_too_far_is_taken_with_the_setting_that_is_said(tmp_path: Path) -> None:
    scene = table_scene()
    lines = said_of(tmp_path, np.vstack([scene, scene[scene[:, 0] > 0] + [0.0, 0.0, 2.0]]))
    assert any("points: not 0 to 2 m away; '+segmenter.depth_range=[0,3]' takes them" in line for line in lines)
    assert again(tmp_path, lines, "m away") >= 2
    with pytest.raises(CloudError, match=r"depth_range=\[0,4\]"):
        Segmenter().segment(moved(scene, z=3.0))


def test_what_is_too_low_or_too_high_is_said_with_its_setting(tmp_path: Path) -> None:
    tower = moved(box_top(0.05, 0.05, 0.6), y=-0.1)
    scene = on_a_table(moved(box(), y=0.15), tower, moved(box_top(0.06, 0.06, 0.007), x=0.15))
    lines = said_of(tmp_path, scene, segmenter=Segmenter(min_height=0.01))
    assert again(tmp_path, lines, "only 7 mm high") == 3
    assert again(tmp_path, lines, "m above the table") >= 1
    assert any("+segmenter.max_height=" in line for line in lines)


@pytest.mark.parametrize("height", [0.0, 0.75])
def test_a_world_frame_cloud_is_recognised_and_frame_world_is_said(tmp_path: Path, height: float) -> None:
    world = table_scene() * [1, -1, -1] + [0.3, 0.0, 0.7 + height]
    assert "no camera can stand at the cloud's origin, under the table: this is no camera's frame; say frame=world" in (
        said_of(tmp_path, world)
    )
    (file,) = json.loads((tmp_path / "results.json").read_text())["files"]
    assert len(file["objects"]) == 2
    assert file["table"][2] > 0.99
    assert not any("frame=world" in line for line in said_of(tmp_path, world, up=(0, 0, 1)))
    assert not any("frame=world" in line for line in said_of(tmp_path, table_scene()))


def test_up_that_fits_no_plane_is_said_to_be_the_reason(tmp_path: Path) -> None:
    tilted = table_scene() @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    lines = said_of(tmp_path, tilted, up=(0, 0, 1))
    assert any(line.startswith("no table:") and "frame=world" in line for line in lines)


def test_the_selective_grasper_says_what_was_left_out_and_how_to_have_it() -> None:
    scene = on_a_table(moved(box(), y=0.15), moved(box_top(0.52, 0.06, 0.08), y=-0.1))
    grasper = SelectiveGrasper(lambda points: ("box", 0.9), task().planner)
    assert "0.52 m large, more than 0.45 m (say max_extent=0.55)" in (grasper.select(scene, "bottle").reason or "")
    assert "say max_extent=0.55" in Segmenter().segment(scene).summary()
