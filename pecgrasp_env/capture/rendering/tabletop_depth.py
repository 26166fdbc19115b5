"""What an exact camera sees of a laid table: the objects' frames, one upon the other, over the planes behind them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pecgrasp_env.scene.table import FLOOR_Z, TABLE_X, TABLE_Y

if TYPE_CHECKING:
    from pecgrasp_env.capture.rendering.depth_renderer import Frame, Shot
    from pecgrasp_env.sensor import CameraIntrinsics

__all__ = ["Table", "background_depth", "compose"]


@dataclass(frozen=True)
class Table:
    """Exact depth of a scene (H, W) m, and which object each pixel shows: (H, W) int16, 0 for none, else 1 + index.

    occlusion: of each object the share that others hide; NaN where some of it is outside of the image.
    """

    depth: np.ndarray
    owner: np.ndarray
    occlusion: np.ndarray


def compose(
    shots: Sequence[Shot], frames: Sequence[Frame], T_base_camera: np.ndarray, camera: CameraIntrinsics
) -> Table:
    """The scene of which `frames` show each object alone, as `shots` asked for."""
    depth = background_depth(T_base_camera, camera)
    owner = np.zeros(depth.shape, np.int16)
    alone = np.zeros(len(shots))
    for i, frame in enumerate(frames):
        window = frame.intrinsics
        row, column = round(camera.cy - window.cy), round(camera.cx - window.cx)
        here = (slice(row, row + window.height), slice(column, column + window.width))
        nearer = (frame.depth > 0) & ((frame.depth < depth[here]) | (depth[here] == 0))
        depth[here][nearer] = frame.depth[nearer]
        owner[here][nearer] = i + 1
        alone[i] = np.count_nonzero(frame.depth)
    seen = np.bincount(owner.reshape(-1), minlength=len(shots) + 1)[1:]
    occlusion = 1 - np.divide(seen, alone, out=np.zeros(len(shots)), where=alone > 0)
    cut_off = [not shot.extent.within(camera) for shot in shots]
    return Table(depth, owner, np.where(cut_off, np.nan, occlusion))


def background_depth(T_base_camera: np.ndarray, camera: CameraIntrinsics) -> np.ndarray:
    """(H, W) float32 m: depth of the table's top and, past its edges, of the floor; 0 where a ray meets neither."""
    x = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
    y = ((np.arange(camera.height) + 0.5 - camera.cy) / camera.fy)[:, None]
    R, eye = T_base_camera[:3, :3], T_base_camera[:3, 3]

    def over_pixels(normal: np.ndarray) -> np.ndarray:
        """normal · ray, (H, W)."""
        return (normal @ R)[0] * x + ((normal @ R)[1] * y + (normal @ R)[2])

    downward = over_pixels(np.array([0.0, 0.0, -1.0]))
    # A ray meets the table on the inner side of an edge where it runs on the inner side of the plane of eye and edge.
    on_table = np.ones(downward.shape, bool)
    for axis, (low, high) in enumerate((TABLE_X, TABLE_Y)):
        across, up = eye[2] * np.eye(3)[axis], np.eye(3)[2]
        on_table &= over_pixels(across + (low - eye[axis]) * up) > 0
        on_table &= over_pixels(across + (high - eye[axis]) * up) < 0
    drop = np.where(on_table, eye[2], eye[2] - FLOOR_Z)
    return np.divide(drop, downward, out=np.zeros_like(downward), where=downward > 1e-6).astype(np.float32)
