"""Taking the pictures: the arm is moved by hand, each picture is judged at once, what is lacking is said."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.corners import find_corners
from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.recorded_views import RecordedView, write_views
from pecgrasp_env.real.calibration.variety import variety_of
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_MOST_SHIFT, _MOST_TURN = 2e-4, np.deg2rad(0.02)  # of the hand while a picture is taken
_PATIENCE = 10  # pictures: an arm that was just let go swings for a moment


def record_views(
    folder: Path,
    board: Board,
    take: Callable[[], tuple[np.ndarray, CameraIntrinsics]],
    pose: Callable[[], np.ndarray],
    ask: Callable[[str], bool],
    say: Callable[[str], None],
    parent: str = "tool0",
) -> int:
    """The folder that `calibrate` reads; it is whole after each picture. Returns how many there are.

    Args:
        folder: must hold no views yet.
        board: that is looked at.
        take: a picture (H, W) uint8 and its intrinsics.
        pose: T_base_tool0 (4, 4) now.
        ask: whether to take one more, once the arm is where it should be.
        say: tells the person what was seen and what is lacking.
        parent: "tool0" or "base", which carries the camera.

    Raises CalibrationError for a folder that holds views.
    """
    if (folder / "poses.csv").exists():
        raise CalibrationError(f"{folder} holds views already: name another folder, or take it away")
    views: list[RecordedView] = []
    while ask(f"picture {len(views) + 1}: bring the board into view, another turn than before, let go"):
        for _ in range(_PATIENCE):
            before = pose()
            image, intrinsics = take()
            after = pose()
            if stood := _stood(before, after):
                break
        if not stood:
            say("not kept: the arm still moved")
            continue
        found = find_corners(image, board)
        if isinstance(found, str):
            say(f"not kept: {found}")
            continue
        views.append(RecordedView(f"view_{len(views) + 1:02d}.png", image, after))
        write_views(folder, intrinsics, views)
        say(f"kept: {len(found.numbers)} of {board.n_corners} corners{_lacking(views, parent)}")
    return len(views)


def _stood(T_base_tool0_before: np.ndarray, T_base_tool0_after: np.ndarray) -> bool:
    moved = np.linalg.inv(T_base_tool0_before) @ T_base_tool0_after
    turn = Rotation.from_matrix(moved[:3, :3]).magnitude()
    return bool(np.linalg.norm(moved[:3, 3]) <= _MOST_SHIFT and turn <= _MOST_TURN)


def _lacking(views: list[RecordedView], parent: str) -> str:
    poses = np.array([view.T_base_tool0 for view in views])
    mount_world = np.linalg.inv(poses) if parent == "tool0" else poses
    if len(views) < 3:
        return ""
    try:
        words = variety_of([view.name for view in views], mount_world, parent).words
    except CalibrationError as error:
        words = [str(error)]
    return f"; so far: {words[0]}" if words else "; enough, if you like"
