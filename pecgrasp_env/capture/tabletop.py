"""The `tabletop` scenario, what the robot sees: one object at rest on a table, looked down at by the wrist camera.

The object lies as it comes to rest after a fall in a random orientation, turned at random about the vertical, anywhere
in the picture. The camera stands 0.4 to 0.7 m from the table, straight above or tilted. The table is a plane, so its
depth is computed, not drawn; the sensor sees both. What segmentation takes for table is cut off: the object's points
within a few millimetres of the plane, the height drawn for each sample. The dissertation has no such set.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.capture.samples import rotation_matrix, sample_seed
from pecgrasp_env.capture.studio import DepthStudio
from pecgrasp_env.placement import settle
from pecgrasp_env.sensor import CameraIntrinsics, deproject_mask

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["TabletopScenario", "camera_above_table", "resting_poses", "table_depth"]

_DROP_HEIGHT = 0.02
_SPACING = 1.0


def resting_poses(model: ObjectModel, drops: int, seed: int) -> np.ndarray:
    """Poses (k, 4, 4) in which an object rests on the plane z = 0, as often as it falls into each of them.

    `drops` orientations, uniform on SO(3), fall side by side in one physics scene; those still in motion at the end are
    left out. x and y are 0. Raises CaptureError where none comes to rest.
    """
    rng = np.random.default_rng(sample_seed(seed, model.class_name, model.instance, -1 % 2**32))
    corners = np.concatenate(model.hulls)
    starts = np.zeros((drops, 7))
    for row, quaternion in enumerate(rng.standard_normal((drops, 4))):
        lowest = (corners @ rotation_matrix(quaternion).T)[:, 2].min()
        starts[row] = row * _SPACING, 0.0, _DROP_HEIGHT - lowest, *(quaternion / np.linalg.norm(quaternion))
    ends, at_rest = settle([model] * drops, starts)
    if not at_rest.any():
        raise CaptureError(f"{model.instance}: none of {drops} drops came to rest on the table")
    poses = np.tile(np.eye(4), (int(at_rest.sum()), 1, 1))
    for pose, end in zip(poses, ends[at_rest], strict=True):
        pose[:3, :3] = rotation_matrix(end[3:])
        pose[2, 3] = end[2]
    return poses


def camera_above_table(distance: float, tilt: float, azimuth: float) -> np.ndarray:
    """T_camera_table (4, 4) of a camera that looks at the table's origin.

    distance: m; tilt: angle of the optical axis from the vertical, rad; azimuth: of the camera about the vertical, rad.
    Table frame: z up. With tilt and azimuth 0 the camera's x axis is the table's, its y axis opposite to the table's.
    """
    turn = np.array([[np.cos(azimuth), -np.sin(azimuth), 0], [np.sin(azimuth), np.cos(azimuth), 0], [0, 0, 1]])
    c, s = np.cos(tilt), np.sin(tilt)
    down = np.diag([1.0, -1.0, -1.0])
    T = np.eye(4)
    T[:3, :3] = np.array([[1, 0, 0], [0, c, s], [0, -s, c]]) @ down @ turn
    T[2, 3] = distance
    return T


def table_depth(T_camera_table: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
    """(H, W) float32 m: depth of the plane z = 0 of the table frame, 0 where a ray does not meet it."""
    normal, offset = T_camera_table[:3, 2], T_camera_table[:3, 2] @ T_camera_table[:3, 3]
    x = (np.arange(intrinsics.width) + 0.5 - intrinsics.cx) / intrinsics.fx
    y = (np.arange(intrinsics.height) + 0.5 - intrinsics.cy) / intrinsics.fy
    inverse = (normal[0] * x + normal[1] * y[:, None] + normal[2]) / offset
    return np.divide(1, inverse, out=np.zeros_like(inverse), where=inverse > 1e-3).astype(np.float32)


class TabletopScenario:
    """One object at rest on a table, under a camera that looks down."""

    def __init__(self, config: CaptureConfig) -> None:
        self._config = config
        self._table = config.tabletop
        self._studio = DepthStudio(config)
        self._resting = np.zeros((0, 4, 4))

    def show(self, model: ObjectModel) -> None:
        self._studio.show(model)
        self._resting = resting_poses(model, self._table.drops, self._config.seed)

    def attempt(self, rng: np.random.Generator) -> tuple[np.ndarray | None, np.ndarray, str]:
        T_camera_table, pose = self._draw(rng)
        frame, reason = self._studio.photograph(pose)
        if frame is None:
            return None, pose, reason
        table = table_depth(T_camera_table, frame.intrinsics)
        on_object = (frame.depth > 0) & ((frame.depth < table) | (table == 0))
        depth = self._studio.measure(np.where(on_object, frame.depth, table), frame.intrinsics, rng)
        points = deproject_mask(depth, on_object, frame.intrinsics)
        height = (points - T_camera_table[:3, 3].astype(np.float32)) @ T_camera_table[:3, 2].astype(np.float32)
        points = points[height > rng.uniform(*self._table.cut)]
        if len(points) < self._config.min_points:
            return None, pose, "too few points"
        return points, pose, ""

    def _draw(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """T_camera_table and T_camera_object, (4, 4) each."""
        camera = self._studio.intrinsics
        T_camera_table = camera_above_table(
            rng.uniform(*self._table.distance), rng.uniform(0, self._table.max_tilt), rng.uniform(-np.pi, np.pi)
        )
        # A pixel at random, and the object where its ray meets the table.
        pixel = rng.uniform((0, 0), (camera.width, camera.height))
        ray = np.array([(pixel[0] - camera.cx) / camera.fx, (pixel[1] - camera.cy) / camera.fy, 1.0])
        normal, origin = T_camera_table[:3, 2], T_camera_table[:3, 3]
        place = ray * (normal @ origin) / (normal @ ray)
        yaw = rng.uniform(-np.pi, np.pi)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        T_table_object = turn @ self._resting[rng.integers(len(self._resting))]
        T_table_object[:3, 3] += T_camera_table[:3, :3].T @ (place - origin)
        return T_camera_table, T_camera_table @ T_table_object
