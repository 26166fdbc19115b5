"""From views to the camera's place, what speaks for it, and in plain words what speaks against it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.corners import Corners, find_corners
from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.hand_eye import BoardView, HandEye, calibrate_hand_eye
from pecgrasp_env.real.calibration.recorded_views import RecordedView
from pecgrasp_env.real.calibration.variety import Variety, variety_of
from pecgrasp_env.robot.camera_mount import PARENTS
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_OUTLIER = 4.0  # times the median of all views' errors
_GOOD_SHIFT, _GOOD_TURN = 3e-3, np.deg2rad(0.6)  # RMS of the views: beyond, something is wrong rather than noisy
_WRONG_SCALE = 0.01


@dataclass(frozen=True)
class Calibration:
    """parent: "tool0" or "base", which carries the camera. used: the views that show the board, with what they show.
    left_out: the others' names, and why. words: what is to be mended, in plain English; empty: nothing.
    """

    parent: str
    intrinsics: CameraIntrinsics
    used: list[tuple[RecordedView, Corners]]
    left_out: list[tuple[str, str]]
    hand_eye: HandEye
    variety: Variety
    words: list[str]


def calibrate(
    intrinsics: CameraIntrinsics, views: list[RecordedView], board: Board, parent: str = "tool0"
) -> Calibration:
    """parent: "tool0" where the hand carries the camera and the board lies still; "base" where the camera stands still
    and the hand carries the board. Raises CalibrationError where no place follows.
    """
    if parent not in PARENTS:
        raise CalibrationError(f"parent={parent}: tool0, for a camera on the hand, or base, for one beside the robot")
    used, left_out = [], []
    for view in views:
        found = find_corners(view.image, board)
        if isinstance(found, str):
            left_out.append((view.name, found))
        else:
            used.append((view, found))
    if len(used) < len(views) and not used:
        raise CalibrationError(f"no image shows the board; {left_out[0][0]}: {left_out[0][1]}")
    seen = [
        BoardView(view.name, np.linalg.inv(view.T_base_tool0) if parent == "tool0" else view.T_base_tool0, corners)
        for view, corners in used
    ]
    if len(seen) >= 2:
        variety = variety_of([view.name for view in seen], np.array([view.T_mount_world for view in seen]), parent)
    hand_eye = calibrate_hand_eye(seen, intrinsics, parent)
    words = [*_doubts(hand_eye, seen), *variety.words]
    return Calibration(parent, intrinsics, used, left_out, hand_eye, variety, words)


def _doubts(hand_eye: HandEye, views: list[BoardView]) -> list[str]:
    best = hand_eye.best
    words = []
    if abs(hand_eye.scale - 1) > _WRONG_SCALE:
        words.append(
            f"by the arm's motions the board is {hand_eye.scale:.3f} times as large as board.square says: was it "
            "printed at 100 %? Measure its ruler; else the focal length in camera.yaml is wrong by as much"
        )
    limits = (max(_OUTLIER * np.median(best.shift), _GOOD_SHIFT), max(_OUTLIER * np.median(best.turn), _GOOD_TURN))
    outliers = [k for k in range(len(views)) if best.shift[k] > limits[0] or best.turn[k] > limits[1]]
    words += [
        f"{views[k].name} does not fit the others by {1e3 * best.shift[k]:.1f} mm and "
        f"{np.degrees(best.turn[k]):.1f}°: was the arm still when it was taken? Leave it out of poses.csv"
        for k in outliers
    ]
    _, shift, turn = best.rms
    if not outliers and (shift > _GOOD_SHIFT or turn > _GOOD_TURN):
        words.append(
            f"the views contradict each other by {1e3 * shift:.1f} mm and {np.degrees(turn):.1f}°: are the poses those "
            "of tool0 (the controller's TCP set to zero), in order with the images, in metres and radians? Did the "
            "board, or the camera on its bracket, move?"
        )
    return words
