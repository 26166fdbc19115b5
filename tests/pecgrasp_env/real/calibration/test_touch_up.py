"""The check without a board: a right place passes, a wrong one is said to be wrong by as much as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from board_views import HAS_HAND_EYE, motion

from pecgrasp_env.policy.viewpoints import look_at
from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.recorded_views import RecordedView, write_views
from pecgrasp_env.real.calibration.touch_up import check_folder, touch_up
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA
from pecgrasp_env.sensor.d435_noise import apply_d435
from pecgrasp_env.sensor.intrinsics import D435

CAMERA = D435["424x240"]
# Turned about the line of sight, too: what is wrong in the camera's own frame must not be wrong alike in all views.
TURNS = (0.0, 70.0, -70.0, 150.0)
EYES = ((0.50, 0.0, 0.5), (0.38, 0.2, 0.42), (0.36, -0.2, 0.42), (0.62, 0.15, 0.45))
BOX = np.array([[0.44, -0.03, 0.0], [0.55, 0.05, 0.09]])  # its lowest and highest corner, base frame


def depth_of(T_base_camera: np.ndarray, with_box: bool = True) -> np.ndarray:
    """(240, 424) m: a box on the table z = 0, exact, by where each ray enters."""
    v, u = np.indices((CAMERA.height, CAMERA.width)) + 0.5
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1)
    rays = rays @ T_base_camera[:3, :3].T
    eye = T_base_camera[:3, 3]
    depth = -eye[2] / rays[..., 2]
    near, far = np.sort((BOX[:, None, None] - eye) / rays, axis=0)
    enters, leaves = near.max(axis=-1), far.min(axis=-1)
    return np.where(with_box & (enters < leaves), np.minimum(enters, depth), depth)


def views(with_box: bool = True) -> list[RecordedView]:
    rng = np.random.default_rng(0)
    found = []
    for number, (eye, turn) in enumerate(zip(EYES, TURNS, strict=True)):
        T = look_at(eye, (0.5, 0.0, 0.02)) @ motion(0, 0, 0, (0, 0, turn))
        depth = apply_d435(depth_of(T, with_box), CAMERA, rng)
        found.append(RecordedView(f"depth_{number}.png", depth, T @ np.linalg.inv(T_TOOL0_CAMERA)))
    return found


def checked(T_tool0_camera: np.ndarray, with_box: bool = True):
    seen = views(with_box)
    poses = [view.T_base_tool0 @ T_tool0_camera for view in seen]
    return touch_up([view.name for view in seen], [view.image for view in seen], [CAMERA] * len(seen), poses)


def test_the_true_place_passes():
    result = checked(T_TOOL0_CAMERA)
    assert result.words == []
    assert abs(result.table_height) < 0.003
    assert [each.object_mm is not None for each in result.views] == [False, True, True, True]


def test_a_camera_beside_its_place_sees_two_objects():
    words = checked(T_TOOL0_CAMERA @ motion(0.012, 0.0, 0, (0, 0, 0))).words
    assert any("see the object" in each for each in words)


def test_a_camera_tilted_by_two_degrees_sees_several_tables():
    result = checked(T_TOOL0_CAMERA @ motion(0, 0, 0, (2, 0, 0)))
    assert any("see the table" in each for each in result.words)
    assert max(each.table_degrees for each in result.views if each.table_degrees is not None) > 1


def test_a_table_without_a_thing_on_it_is_said():
    words = checked(T_TOOL0_CAMERA, with_box=False).words
    assert len(words) == len(EYES)
    assert all("the object of the first view is not seen" in each for each in words)


def test_a_view_without_a_table_leaves_too_few():
    with pytest.raises(CalibrationError, match="0 of 1 views show a table"):
        touch_up(["a"], [np.zeros((240, 424), np.float32) + np.eye(240, 424, dtype=np.float32)], [CAMERA], [np.eye(4)])


@pytest.mark.skipif(not HAS_HAND_EYE, reason="pip install '.[calibrate]'")
def test_depth_images_of_a_folder_are_checked(tmp_path: Path):
    write_views(tmp_path, CAMERA, views())
    assert check_folder(tmp_path, T_TOOL0_CAMERA).words == []
    write_views(tmp_path, CAMERA, [RecordedView("a.png", np.zeros((240, 424), np.uint8), np.eye(4))])
    with pytest.raises(CalibrationError, match="expected uint16"):
        check_folder(tmp_path, T_TOOL0_CAMERA)
