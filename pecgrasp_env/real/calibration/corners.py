"""The board's corners in one image, and where the board therefore is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.opencv import opencv
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

LEAST_CORNERS = 8  # six would do; near the image's border some are wrong


@dataclass(frozen=True)
class Corners:
    """What one image shows of the board.

    numbers: (k,) of the corners. board: (k, 3) in the board's frame, m. pixels: (k, 2) x and y from the image's
    corner, in which a pixel covers [c, c + 1).
    """

    numbers: np.ndarray
    board: np.ndarray
    pixels: np.ndarray


def find_corners(image: np.ndarray, board: Board) -> Corners | str:
    """The corners in an image (H, W) uint8, or why it is of no use."""
    pixels, numbers, _, markers = opencv().aruco.CharucoDetector(board.charuco).detectBoard(image)
    if numbers is None or len(numbers) < LEAST_CORNERS:
        found = 0 if numbers is None else len(numbers)
        if markers is None or not len(markers):
            return "no marker of the board is seen: too far, too dark, or another board"
        return f"{found} corners of the board are seen, at least {LEAST_CORNERS} are needed"
    order = np.asarray(numbers).reshape(-1)
    on_board = board.corners[order]
    if np.linalg.svd(on_board - on_board.mean(axis=0), compute_uv=False)[1] < board.square:
        return "all corners that are seen lie on one line"
    # OpenCV counts from the first pixel's centre.
    return Corners(order, on_board, np.asarray(pixels, float).reshape(-1, 2) + 0.5)


def board_pose(corners: Corners, intrinsics: CameraIntrinsics) -> np.ndarray:
    """T_camera_board (4, 4) of one image alone, by least squares of the pixels."""
    cv2 = opencv()
    pixels = np.ascontiguousarray(corners.pixels).reshape(-1, 1, 2)
    _, turn, place = cv2.solvePnP(corners.board, pixels, intrinsics.matrix, None, flags=cv2.SOLVEPNP_IPPE)
    turn, place = cv2.solvePnPRefineLM(corners.board, pixels, intrinsics.matrix, None, turn, place)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(turn)[0], place.reshape(3)
    return T


def project(points: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
    """Points (…, 3) of the camera frame, m → (…, 2) pixels from the image's corner."""
    u = intrinsics.fx * points[..., 0] / points[..., 2] + intrinsics.cx
    return np.stack([u, intrinsics.fy * points[..., 1] / points[..., 2] + intrinsics.cy], axis=-1)
