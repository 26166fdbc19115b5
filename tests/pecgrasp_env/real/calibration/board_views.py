"""Views of the board by a hand whose camera is at a known place, drawn once for all tests."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.opencv import opencv
from pecgrasp_env.real.calibration.recorded_views import RecordedView
from pecgrasp_env.real.errors import MissingExtra
from pecgrasp_env.real.fakes.board_images import draw_board, looks_at_board, shaken
from pecgrasp_env.sensor.intrinsics import intrinsics_of

try:
    HAS_HAND_EYE = bool(opencv())
except MissingExtra:
    HAS_HAND_EYE = False
BOARD = Board()
CAMERA = intrinsics_of("848x480")


def motion(x: float, y: float, z: float, turn: tuple[float, float, float]) -> np.ndarray:
    """(4, 4); m, and turns about x, y and z, degrees."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", turn, degrees=True).as_matrix()
    T[:3, 3] = x, y, z
    return T


# A bracket that is not the drawing's, and a camera beside the robot.
MOUNTS = {"tool0": motion(0.012, -0.117, 0.061, (14, 2, -3)), "base": motion(0.9, 0.3, 0.6, (200, 25, 100))}


@cache
def board_views(count: int, seed: int, parent: str = "tool0") -> tuple[RecordedView, ...]:
    """With a D435's noise, and an arm that is true to 0.1 mm and 0.2 mrad along and about each axis."""
    rng = np.random.default_rng(seed)
    T_base_board = motion(0.45, 0.08, 0.003, (180, 0, 30))
    T_tool0_board = motion(-0.12, -0.09, 0.03, (0, 0, 5))
    views = []
    for number, T_board_camera in enumerate(looks_at_board(BOARD, count, rng)):
        T_camera_board = np.linalg.inv(T_board_camera)
        image = draw_board(BOARD, T_camera_board, CAMERA, rng)
        if parent == "tool0":
            T_base_tool0 = T_base_board @ T_board_camera @ np.linalg.inv(MOUNTS[parent])
        else:
            T_base_tool0 = MOUNTS[parent] @ T_camera_board @ np.linalg.inv(T_tool0_board)
        views.append(RecordedView(f"view_{number:02d}.png", image, shaken(T_base_tool0, rng, 1e-4, 2e-4)))
    return tuple(views)


def error_of(T: np.ndarray, parent: str = "tool0") -> tuple[float, float]:
    """Of a camera's place from the true one: m, rad."""
    off = np.linalg.inv(MOUNTS[parent]) @ T
    return float(np.linalg.norm(off[:3, 3])), float(Rotation.from_matrix(off[:3, :3]).magnitude())
