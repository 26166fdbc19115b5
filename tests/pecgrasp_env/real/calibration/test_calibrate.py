"""Hand-eye calibration on drawn pictures of the board: what it finds, what it calls wrong, what it leaves."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from board_views import BOARD, CAMERA, HAS_HAND_EYE, MOUNTS, board_views, error_of, motion
from scipy.spatial.transform import Rotation

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.calibrate import calibrate
from pecgrasp_env.real.calibration.corners import Corners, board_pose, find_corners, project
from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.folder import calibrate_folder
from pecgrasp_env.real.calibration.hand_eye import METHODS, REFINED, BoardView, calibrate_hand_eye
from pecgrasp_env.real.calibration.recorded_views import RecordedView, read_views, write_views
from pecgrasp_env.real.calibration.variety import variety_of
from pecgrasp_env.real.fakes.board_images import draw_board
from pecgrasp_env.robot.camera_mount import read_mount
from pecgrasp_env.robot.kinematics import HOME, forward_kinematics

pytestmark = pytest.mark.skipif(not HAS_HAND_EYE, reason="pip install '.[calibrate]'")


def exact_views(n: int, seed: int, mount: str = "tool0") -> list[BoardView]:
    """Views whose corners lie exactly where they should, from poses all about."""
    rng = np.random.default_rng(seed)
    views = []
    while len(views) < n:
        T_camera_board = motion(*rng.uniform(-0.1, 0.05, 2), rng.uniform(0.3, 0.5), tuple(rng.uniform(-30, 30, 3)))
        points = BOARD.corners @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]
        corners = Corners(np.arange(BOARD.n_corners), BOARD.corners, project(points, CAMERA))
        T_mount_world = MOUNTS[mount] @ T_camera_board @ np.linalg.inv(motion(0.4, 0.1, 0, (180, 0, 30)))
        views.append(BoardView(str(len(views)), T_mount_world, corners))
    return views


def noisy_views(n: int, seed: int) -> list[BoardView]:
    rng = np.random.default_rng(seed)
    return [
        replace(view, corners=replace(view.corners, pixels=view.corners.pixels + rng.normal(0, 0.1, (24, 2))))
        for view in exact_views(n, seed)
    ]


@pytest.mark.parametrize("mount", MOUNTS)
def test_exact_views_give_the_exact_place_by_every_method(mount):
    found = calibrate_hand_eye(exact_views(8, 0, mount), CAMERA, mount)
    assert [found.best.method, *sorted(each.method for each in found.methods[1:])] == [REFINED, *sorted(METHODS)]
    for each in found.methods:
        off, turned = error_of(each.T_mount_camera, mount)
        assert off < 2e-6
        assert turned < 1e-5
        np.testing.assert_allclose(each.T_world_board, motion(0.4, 0.1, 0, (180, 0, 30)), atol=1e-5)
    assert found.scale == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize(("parent", "count"), [("tool0", 20), ("base", 15)])
def test_noisy_pictures_give_the_place_to_a_millimetre_and_a_fifth_of_a_degree(parent, count):
    result = calibrate(CAMERA, list(board_views(count, 1, parent)), BOARD, parent)
    off, turned = error_of(result.hand_eye.best.T_mount_camera, parent)
    assert off < 1e-3
    assert np.degrees(turned) < 0.2
    assert result.words == []
    assert len(result.used) == count
    # The error that is claimed is about the one that is made: within four standard errors.
    assert off < 4 * np.linalg.norm(result.hand_eye.uncertainty[:3])
    assert turned < 4 * np.linalg.norm(result.hand_eye.uncertainty[3:])


def test_corners_are_found_to_a_fifth_of_a_pixel():
    rng = np.random.default_rng(3)
    T = motion(-0.1, -0.06, 0.35, (20, -15, 10))
    found = find_corners(draw_board(BOARD, T, CAMERA, rng), BOARD)
    assert not isinstance(found, str)
    expected = project(found.board @ T[:3, :3].T + T[:3, 3], CAMERA)
    assert len(found.numbers) == BOARD.n_corners
    assert np.sqrt(np.mean((found.pixels - expected) ** 2)) < 0.2


def test_leaving_a_view_out_by_one_step_is_leaving_it_out():
    views = noisy_views(10, 5)
    found = calibrate_hand_eye(views, CAMERA)
    for k in (0, 7):
        others = calibrate_hand_eye([*views[:k], *views[k + 1 :]], CAMERA).best
        expected = np.linalg.inv(others.T_mount_camera) @ views[k].T_mount_world @ others.T_world_board
        middle = np.append(views[k].corners.board.mean(axis=0), 1)
        shift = np.linalg.norm((expected - board_pose(views[k].corners, CAMERA)) @ middle)
        assert found.best.shift[k] == pytest.approx(shift, rel=0.05)


def test_a_wrong_pose_is_named():
    views = list(board_views(20, 1))
    views[4] = replace(views[4], T_base_tool0=views[4].T_base_tool0 @ motion(0.02, 0, 0, (0, 0, 0)))
    words = calibrate(CAMERA, views, BOARD).words
    assert [each.split()[0] for each in words if "does not fit" in each] == ["view_04.png"]


def test_a_board_printed_smaller_than_it_is_said_to_be_is_named():
    words = calibrate(CAMERA, list(board_views(20, 1)), Board(square=0.0361, marker=0.0268)).words
    assert any(re.search(r"the board is 0.9[67]\d times as large as board.square", each) for each in words)


def test_poses_of_something_else_are_named():
    shuffled = np.random.default_rng(0).permutation(20)
    views = list(board_views(20, 1))
    views = [replace(view, T_base_tool0=views[k].T_base_tool0) for view, k in zip(views, shuffled, strict=True)]
    words = calibrate(CAMERA, views, BOARD).words
    assert any("contradict each other" in each or "does not fit" in each for each in words)


def turned(axes: np.ndarray) -> np.ndarray:
    """Poses (n, 4, 4) by rotation vectors (n, 3), degrees, some centimetres apart."""
    poses = np.tile(np.eye(4), (len(axes), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(np.radians(axes)).as_matrix()
    poses[:, 0, 3] = 0.02 * np.arange(len(axes))
    return poses


def test_turns_about_one_axis_alone_are_refused_with_the_axis_to_turn_about():
    poses = turned(np.linspace(-40, 40, 16)[:, None] * [0, 0, 1])
    with pytest.raises(CalibrationError, match=r"about one axis only, near its z, by \d+°.* turn it about its [xy]"):
        variety_of([str(k) for k in range(16)], poses, "tool0")


def test_what_the_poses_lack_is_said():
    axes = np.random.default_rng(0).uniform(-1, 1, (16, 3)) * [5, 2, 40]
    lacking = variety_of([str(k) for k in range(16)], turned(axes), "tool0").words
    assert len(lacking) == 1
    assert "about its x spread by" in lacking[0]
    axes = np.random.default_rng(0).uniform(-30, 30, (16, 3))
    assert variety_of([str(k) for k in range(16)], turned(axes), "tool0").words == []
    twice = np.concatenate([turned(axes), turned(axes)[3:4]])
    assert variety_of([str(k) for k in range(17)], twice, "tool0").words == ["16 nearly repeats 3: it adds little"]


def test_fewer_than_four_views_are_refused():
    with pytest.raises(CalibrationError, match="3 views show the board, at least 4"):
        calibrate_hand_eye(exact_views(3, 0), CAMERA)


def test_a_folder_leaves_the_cameras_file_the_figures_and_a_page(tmp_path: Path, outline: Callable):
    views = list(board_views(20, 1))[:10]
    blank = RecordedView("blank.png", np.full((480, 848), 90, np.uint8), np.eye(4))
    write_views(tmp_path / "views", CAMERA, [*views, blank])
    result = calibrate_folder(tmp_path / "views", BOARD, "tool0", tmp_path / "out")
    T = read_mount(tmp_path / "out/T_tool0_camera.yaml")
    np.testing.assert_allclose(T, result.hand_eye.best.T_mount_camera, atol=1e-8)
    kept = json.loads((tmp_path / "out/results.json").read_text())
    assert kept["methods"][0]["method"] == REFINED
    assert len(kept["methods"]) == 6
    assert [each["name"] for each in kept["views"]] == [view.name for view in views]
    assert kept["left_out"] == [
        {"name": "blank.png", "why": "no marker of the board is seen: too far, too dark, or another board"}
    ]
    page = outline((tmp_path / "out/calibration.html").read_text())
    assert sum(address.startswith("data:image/jpeg") for address in page.addresses) == 10
    assert "10 views: 15 to 20 average more of the noise away" in page.text


@pytest.mark.parametrize("form", ["quaternion", "vector", "joints"])
def test_poses_are_read_in_three_forms(form, tmp_path: Path):
    T = forward_kinematics(HOME)
    turn = Rotation.from_matrix(T[:3, :3])
    head, values = {
        "quaternion": ("x,y,z,qw,qx,qy,qz", [*T[:3, 3], *turn.as_quat()[[3, 0, 1, 2]]]),
        "vector": ("x,y,z,rx,ry,rz", [*T[:3, 3], *turn.as_rotvec()]),
        "joints": ("q1,q2,q3,q4,q5,q6", HOME),
    }[form]
    write_views(tmp_path, CAMERA, [RecordedView("a.png", np.zeros((480, 848), np.uint8), T)])
    (tmp_path / "poses.csv").write_text(f"image,{head}\na.png," + ",".join(map(str, values)) + "\n")
    intrinsics, (view,) = read_views(tmp_path)
    np.testing.assert_allclose(view.T_base_tool0, T, atol=1e-9)
    assert intrinsics == replace(CAMERA, min_depth=0.0)


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("camera.yaml", "width: 848\n", r"camera.yaml: .*numbers width, height, fx"),
        ("camera.yaml", "width: 848\nheight: 480\nfx: 45\nfy: 45\ncx: 424\ncy: 240\n", r"focal lengths 45 and 45"),
        ("camera.yaml", "width: 640\nheight: 480\nfx: 400\nfy: 400\ncx: 320\ncy: 240\n", r"a.png: 848 × 480 pixels"),
        ("poses.csv", "image,x,y,z\na.png,0,0,0\n", r"poses.csv: columns image, x, y, z; expected image,x,y,z,qw"),
        ("poses.csv", "image,x,y,z,rx,ry,rz\na.png,0,0,b,0,0,0\n", r"poses.csv, line 2: could not convert"),
        ("poses.csv", "image,x,y,z,rx,ry,rz\na.png,400,0,300,0,0,0\n", r"line 2: tool0 at .*metres"),
        ("poses.csv", "image,x,y,z,rx,ry,rz\na.png,0,0,0.3,180,0,0\n", r"line 2: rotation vector .*radians"),
        ("poses.csv", "image,x,y,z,qw,qx,qy,qz\na.png,0,0,0.3,1,1,0,0\n", r"line 2: quaternion .* length 1.41"),
        ("poses.csv", "image,q1,q2,q3,q4,q5,q6\na.png,90,0,0,0,0,0\n", r"line 2: joint angles .*radians"),
        ("poses.csv", "image,q1,q2,q3,q4,q5,q6\nb.png,0,0,0,0,0,0\n", r"b.png is no image"),
    ],
)
def test_what_a_folder_lacks_is_named(file, text, words, tmp_path: Path):
    write_views(tmp_path, CAMERA, [RecordedView("a.png", np.zeros((480, 848), np.uint8), np.eye(4))])
    (tmp_path / file).write_text(text)
    with pytest.raises(CalibrationError, match=words):
        read_views(tmp_path)
