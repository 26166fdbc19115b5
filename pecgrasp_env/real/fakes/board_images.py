"""Images of the calibration board as a D435's infrared imager would take them, and a hand that carries it about.

The board is a textured plane, so a homography draws it exactly; then lens and sensor: blur, shading, grain, and a
field of small errors that undistortion leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.real.calibration.board import Board
from pecgrasp_env.real.calibration.opencv import opencv
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_FINE = 3  # pixels drawn for one, along each axis
_TEXELS = 4000.0  # of the board's image, a metre
_PAPER_EDGE = 0.012  # m, white around the pattern


@dataclass(frozen=True)
class ImageNoise:
    """blur: of the lens, px. grain: grey levels. shading: share of the light that is lost at the corners.
    undistorted: RMS of what rectification leaves, px; plausible sizes, not measurements.
    """

    blur: float = 0.7
    grain: float = 3.0
    shading: float = 0.3
    undistorted: float = 0.1


def draw_board(
    board: Board,
    T_camera_board: np.ndarray,
    intrinsics: CameraIntrinsics,
    rng: np.random.Generator,
    noise: ImageNoise | None = None,
) -> np.ndarray:
    """(H, W) uint8. Raises ValueError where the board is behind the camera."""
    cv2 = opencv()
    noise = ImageNoise() if noise is None else noise
    width, height = intrinsics.width, intrinsics.height
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) * (*board.size, 0)
    if ((corners @ T_camera_board[:3, :3].T + T_camera_board[:3, 3])[:, 2] <= 0.02).any():
        raise ValueError("the board is behind the camera")
    table = 90 + 25 * _field((height, width), rng, 12.0)
    image = _with_board(table, board, T_camera_board, intrinsics)
    if noise.undistorted > 0:
        v, u = np.indices(image.shape, dtype=np.float32)
        slip = [np.float32(noise.undistorted / np.sqrt(2)) * _field((height, width), rng, width / 12) for _ in range(2)]
        image = cv2.remap(image, u + slip[0], v + slip[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    image = cv2.GaussianBlur(image, (0, 0), noise.blur)
    v, u = np.indices(image.shape, dtype=np.float32)
    away = ((u + 0.5 - width / 2) ** 2 + (v + 0.5 - height / 2) ** 2) / (width**2 + height**2) * 4
    image = image * (1 - noise.shading * away) + noise.grain * rng.standard_normal(image.shape, np.float32)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _with_board(
    table: np.ndarray, board: Board, T_camera_board: np.ndarray, intrinsics: CameraIntrinsics
) -> np.ndarray:
    """The board on its white paper before the grey levels (H, W) float32 of what lies around it."""
    cv2 = opencv()
    texture = board.image(_TEXELS)
    edge = round(_PAPER_EDGE * _TEXELS)
    texture = np.pad(texture, edge, constant_values=255)
    # Texels, counted from the first one's centre → the board's plane → pixels, counted from the image's corner.
    to_board = np.array([[1 / _TEXELS, 0, (0.5 - edge) / _TEXELS], [0, 1 / _TEXELS, (0.5 - edge) / _TEXELS], [0, 0, 1]])
    to_pixels = intrinsics.matrix @ T_camera_board[:3, [0, 1, 3]] @ to_board
    h, w = texture.shape
    rim = to_pixels @ np.array([[0, w, w, 0], [0, 0, h, h], [1, 1, 1, 1]])
    low = np.clip(np.floor((rim[:2] / rim[2]).min(axis=1)).astype(int), 0, table.shape[::-1])
    high = np.clip(np.ceil((rim[:2] / rim[2]).max(axis=1)).astype(int), 0, table.shape[::-1])
    columns, rows = high - low
    image = table.copy()
    if columns < 1 or rows < 1:
        return image
    to_fine = np.array([[_FINE, 0, -_FINE * low[0] - 0.5], [0, _FINE, -_FINE * low[1] - 0.5], [0, 0, 1]])
    homography, size = to_fine @ to_pixels, (int(_FINE * columns), int(_FINE * rows))
    paper = cv2.warpPerspective(texture, homography, size, flags=cv2.INTER_LINEAR).astype(np.float32)
    cover = cv2.warpPerspective(np.full_like(texture, 255), homography, size, flags=cv2.INTER_LINEAR)
    share, paper = (
        each.astype(np.float32).reshape(rows, _FINE, columns, _FINE).mean(axis=(1, 3)) for each in (cover / 255, paper)
    )
    part = np.s_[low[1] : high[1], low[0] : high[0]]
    image[part] = share * 35 + 0.7 * paper + (1 - share) * table[part]  # the paper is black where there is none
    return image


def _field(shape: tuple[int, int], rng: np.random.Generator, smooth: float) -> np.ndarray:
    """(H, W) float32, standard normal, smooth over so many pixels: drawn coarsely, then enlarged."""
    cv2 = opencv()
    step = max(1.0, smooth / 2)
    coarse = rng.standard_normal([max(4, round(side / step)) for side in shape]).astype(np.float32)
    field = cv2.resize(cv2.GaussianBlur(coarse, (0, 0), 1.0), shape[::-1], interpolation=cv2.INTER_CUBIC)
    return field / field.std()


def looks_at_board(
    board: Board, count: int, rng: np.random.Generator, distance: tuple[float, float] = (0.28, 0.45), tilt: float = 0.6
) -> list[np.ndarray]:
    """T_board_camera (4, 4) of views as a person would choose them: from all sides, tilted, turned about the view's
    axis, the board in the image; distance m, tilt rad at most.
    """
    middle = np.array([*board.size, 0]) / 2
    poses = []
    for number in range(count):
        lean, heading = tilt * np.sqrt(rng.uniform(0.05, 1)), 2 * np.pi * (number + rng.uniform()) / count * 3
        eye = middle + rng.uniform(*distance) * np.array(
            [np.sin(lean) * np.cos(heading), np.sin(lean) * np.sin(heading), -np.cos(lean)]
        )
        target = middle + np.append(rng.uniform(-0.03, 0.03, 2), 0)
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross([0, 1, 0], forward)
        right /= np.linalg.norm(right)
        T = np.eye(4)
        T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec([0, 0, rng.uniform(-0.8, 0.8)]).as_matrix()
        T[:3, 3] = eye
        poses.append(T)
    return poses


def shaken(T: np.ndarray, rng: np.random.Generator, shift: float, turn: float) -> np.ndarray:
    """A pose (4, 4) with normal errors along and about each axis, m and rad: how well an arm says where it is."""
    error = np.eye(4)
    error[:3, :3] = Rotation.from_rotvec(rng.normal(0, turn, 3)).as_matrix()
    error[:3, 3] = rng.normal(0, shift, 3)
    return T @ error
