"""Planning on files: scenes, units, clouds without sense, and what is said and drawn of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from grasping_shapes import box_top, moved
from table_scenes import box, on_a_table, table_scene, task

from grasping import CloudError, ConfigError, CurvaturePlanner, Segmenter
from grasping.gripper import ROBOTIQ_2F_140
from grasping.plan_files.plan_file import plan_file
from grasping.plan_files.run import cloud_paths, plan_files


def test_a_scene_in_the_cameras_frame_is_cut_into_objects_which_are_each_planned_on_their_table(tmp_path: Path) -> None:
    np.save(tmp_path / "frame.npy", table_scene())
    file = plan_file(tmp_path / "frame.npy", task(segmenter=Segmenter(), up=None))
    assert file.error is None
    assert file.scene is not None
    np.testing.assert_allclose(file.scene.plane, [0, 0, -1, 0.7], atol=2e-3)
    assert len(file.objects) == 2
    for each in file.objects:
        assert each.plan.best is not None
        approach, tips = each.plan.best.pose[:3, 2], each.plan.best.pose[:3, 3]
        assert approach[2] > 0.8  # down on the table, along the camera's view
        assert (tips + 0.5 * ROBOTIQ_2F_140.pad_length * approach)[2] < 0.7
        assert len(each.surroundings) > 100


def test_neighbours_are_obstacles(tmp_path: Path) -> None:
    # 28 mm beside the box is no room for a finger of 18 mm and a clearance of 15 mm.
    walls = [moved(box_top(0.2, 0.02, 0.1), y=y) for y in (-0.063, 0.063)]
    planner = CurvaturePlanner(side_clearance=0.015)
    closing = []
    for beside in ([], walls):
        np.save(tmp_path / "frame.npy", on_a_table(box(), *beside))
        file = plan_file(tmp_path / "frame.npy", task(planner=planner, segmenter=Segmenter(), up=None))
        assert len(file.objects) == 1 + len(beside)
        (own,) = [each for each in file.objects if np.abs(each.points[:, :2].mean(axis=0)).max() < 0.03]
        assert own.plan.best is not None
        closing.append(abs(own.plan.best.pose[1, 0]))
    assert closing[0] > 0.95
    assert closing[1] < 0.3


@pytest.mark.parametrize(("scene", "points"), [(False, box() * 1000), (True, table_scene() * 1000)])
def test_millimetres_are_recognised_and_the_message_says_what_to_set(tmp_path, scene: bool, points: np.ndarray) -> None:
    np.save(tmp_path / "mm.npy", points)
    segmenter = Segmenter() if scene else None
    refused = plan_file(tmp_path / "mm.npy", task(segmenter=segmenter, up=None))
    assert refused.failed
    assert "scale=0.001" in str(refused.error)
    taken = plan_file(tmp_path / "mm.npy", task(segmenter=segmenter, up=None, scale=0.001))
    assert taken.error is None
    assert all(each.plan.best is not None for each in taken.objects)
    assert len(taken.objects) == (2 if scene else 1)


@pytest.mark.parametrize(
    ("points", "scene", "message"),
    [
        (np.zeros((0, 3)), False, "error: it holds no valid point"),
        (np.full((50, 3), np.nan), True, "error: it holds no valid point"),
        (np.ones((3, 3)), False, "error: points: 3 points, at least 10 are needed"),
        (np.ones((3, 3)), True, "no object found: a plane of 3 points: only 3 points in range"),
        (
            box() + 9.0,
            True,
            "none of 1977 points is valid and 0 to 2 m away from its origin; the nearest is 15.",
        ),
    ],
)
def test_a_cloud_without_an_object_says_so(tmp_path: Path, points: np.ndarray, scene: bool, message: str) -> None:
    np.save(tmp_path / "empty.npy", points)
    said: list[str] = []
    segmenter = Segmenter() if scene else None
    results = plan_files([tmp_path / "empty.npy"], task(segmenter=segmenter), tmp_path / "out", say=said.append)
    assert message in said[1]
    assert results["summary"]["failed"] == ("error" in said[1])
    assert results["summary"]["with_grasp"] == 0
    assert (tmp_path / "out" / "plan.html").is_file()


def test_what_makes_a_plan_doubtful_is_said_in_its_row_and_on_the_page(tmp_path: Path) -> None:
    np.save(tmp_path / "frame.npy", table_scene())
    np.save(tmp_path / "alone.npy", moved(box(), z=0.5))
    np.save(tmp_path / "cut.npy", box()[:1800].reshape(60, 30, 3))
    for name, scene, doubt in (
        ("frame.npy", False, "0.60 m large; if this is a whole scene, say scene=true"),
        ("alone.npy", True, "1 object, no table: the largest plane is only"),
        ("cut.npy", True, "cut off by the edge of the image"),
    ):
        said: list[str] = []
        segmenter = Segmenter() if scene else None
        plan_files([tmp_path / name], task(segmenter=segmenter), tmp_path / "out", say=said.append)
        assert any(doubt in line for line in said)
        assert doubt in (tmp_path / "out" / "plan.html").read_text()


def test_paths_that_hold_no_cloud_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="nowhere"):
        cloud_paths(tmp_path / "nowhere")
    with pytest.raises(CloudError, match="no file of this folder"):
        cloud_paths(tmp_path)


@pytest.mark.parametrize(("field", "value"), [("scale", 0.0), ("scale", "mm"), ("up", (0, 0, 0)), ("up", "z")])
def test_settings_without_sense_are_refused_by_name(field: str, value: object) -> None:
    with pytest.raises(ConfigError, match=field):
        task(**{field: value})


@pytest.fixture
def opened(tmp_path: Path, browse):
    np.save(tmp_path / "frame.npy", table_scene())
    plan_files([tmp_path / "frame.npy"], task(segmenter=Segmenter(), up=None), tmp_path / "out", say=lambda line: None)
    return lambda **how: browse((tmp_path / "out" / "plan.html").read_text(), **how)


@pytest.mark.parametrize("how", [{}, {"width": 390, "height": 844}, {"dark": True}], ids=["wide", "phone", "dark"])
def test_the_page_of_a_scene_opens_without_a_complaint_and_fits(opened, how: dict) -> None:
    page = opened(**how)
    assert page.run("document.querySelectorAll('figure.pgv').length") == 3
    assert page.run("document.documentElement.scrollWidth <= innerWidth")
    output = "document.querySelector('output').textContent"
    assert page.run(output).startswith("1 of 2: object ")
    page.run("const s = document.querySelector('input[type=range]'); s.value = 1; s.dispatchEvent(new Event('input'))")
    assert page.run(output).startswith("2 of 2: object ")
    assert page.console == []
