"""A SAPIEN scene that holds one object and photographs its depth: no physics, no lights, nothing else to draw."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import sapien

from pecgrasp_env.sensor import CameraIntrinsics
from pecgrasp_env.sensor.rendering import SAPIEN_FROM_OPENCV, add_depth_camera, set_intrinsics, take_depth

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["DepthStudio"]

_SIDES = (32, 64, 96, 128, 192, 256, 384, 512, 768)
"""Widths and heights of windows, pixels: few enough to keep a camera for each, close enough to waste little."""


class DepthStudio:
    """Photographs one object at a time with one depth camera.

    An empty scene shows nothing but the object, so only the window around it is drawn: a camera whose principal point
    is shifted by whole pixels sees the very rays of the full image. The picture is the same and several times faster.
    """

    def __init__(self, intrinsics: CameraIntrinsics) -> None:
        self.intrinsics = intrinsics
        # SAPIEN's scene asks for a physics system when it ends; it is never stepped.
        self._scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
        self._cameras: dict[tuple[int, int], sapien.render.RenderCameraComponent] = {}
        self._entity: sapien.Entity | None = None

    def show(self, model: ObjectModel) -> None:
        """Put `model` into the scene in place of the object that was there."""
        if self._entity is not None:
            self._scene.remove_entity(self._entity)
            sapien.render.clear_cache()  # SAPIEN keeps every mesh that it ever loaded
        builder = model.add_to(self._scene.create_actor_builder(), collision=False)
        self._entity = sapien.Entity()
        self._entity.add_component(builder.build_render_component())
        self._scene.add_entity(self._entity)

    def photograph(
        self, T_camera_object: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, CameraIntrinsics]:
        """Exact depth of the object within a window that covers the image's rectangle from `low` to `high`.

        Args: T_camera_object (4, 4), OpenCV camera frame; low, high (2,): column and row, pixels, within the image.
        Returns: (h, w) float32 metres, 0 where the object is not; the window's intrinsics.
        """
        if self._entity is None:
            raise RuntimeError("show() an object before photographing it")
        window = self._window(low, high)
        camera = self._cameras.get((window.width, window.height))
        if camera is None:
            camera = add_depth_camera(self._scene, window)
            self._cameras[window.width, window.height] = camera
        set_intrinsics(camera, window)
        pose = np.eye(4)
        pose[:3, :3] = SAPIEN_FROM_OPENCV @ T_camera_object[:3, :3]
        pose[:3, 3] = SAPIEN_FROM_OPENCV @ T_camera_object[:3, 3]
        self._entity.set_pose(sapien.Pose(pose))
        self._scene.update_render()
        return take_depth(camera), window

    def _window(self, low: np.ndarray, high: np.ndarray) -> CameraIntrinsics:
        full = self.intrinsics
        # One more pixel on each side: what the noise model takes from neighbours must be there.
        corner = np.floor(low).astype(int) - 1
        size = np.ceil(high).astype(int) + 1 - corner
        width = min(next((side for side in _SIDES if side >= size[0]), full.width), full.width)
        height = min(next((side for side in _SIDES if side >= size[1]), full.height), full.height)
        column = int(np.clip(corner[0], 0, full.width - width))
        row = int(np.clip(corner[1], 0, full.height - height))
        return full.window(column, row, width, height)
