"""A SAPIEN scene that holds one object and photographs its depth: no physics, no lights, nothing else to draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import sapien
from scipy.spatial import ConvexHull

from pecgrasp_env.capture.config import CaptureConfig, CaptureError
from pecgrasp_env.sensor import CameraIntrinsics, apply_d435, apply_ideal
from pecgrasp_env.sensor.rendering import SAPIEN_FROM_OPENCV, add_depth_camera, set_intrinsics, take_depth

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["DepthStudio", "Frame"]

_SIDES = (32, 64, 96, 128, 192, 256, 384, 512, 768)
"""Widths and heights of windows, pixels: few enough to keep a camera for each, close enough to waste little."""


@dataclass(frozen=True)
class Frame:
    """The part of a depth image that holds the object."""

    depth: np.ndarray
    """(h, w) float32 metres, exact; 0 where the object is not."""
    intrinsics: CameraIntrinsics


class DepthStudio:
    """Photographs one object at a time with the depth camera of a configuration.

    An empty scene shows nothing but the object, so only the window around it is drawn: a camera whose principal point
    is shifted by whole pixels sees the very rays of the full image. The picture is the same and several times faster.
    """

    def __init__(self, config: CaptureConfig) -> None:
        self.intrinsics = config.intrinsics
        self._config = config
        # SAPIEN's scene asks for a physics system when it ends; it is never stepped.
        self._scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
        self._cameras: dict[tuple[int, int], sapien.render.RenderCameraComponent] = {}
        self._entity: sapien.Entity | None = None
        self._outline = np.zeros((0, 3))

    def show(self, model: ObjectModel) -> None:
        """Put `model` into the scene in place of the object that was there.

        Raises CaptureError where it is too large or too small to be captured.
        """
        vertices = np.concatenate([part.vertices for part in model.parts]).astype(np.float64)
        size, largest = float(np.ptp(vertices, axis=0).max()), self._config.max_depth
        if not 0.005 <= size <= largest:
            raise CaptureError(
                f"{model.instance} is {size:.4g} m long; from 0.005 m up to max_depth {largest} m is possible. Is it "
                "in other units? objects.scale=0.001 turns millimetres into metres"
            )
        # The hull's corners project onto the corners of the silhouette: they decide what is in view.
        self._outline = vertices[ConvexHull(vertices).vertices]
        if self._entity is not None:
            self._scene.remove_entity(self._entity)
            sapien.render.clear_cache()  # SAPIEN keeps every mesh that it ever loaded
        builder = model.add_to(self._scene.create_actor_builder(), collision=False)
        self._entity = sapien.Entity()
        self._entity.add_component(builder.build_render_component())
        self._scene.add_entity(self._entity)

    def photograph(self, T_camera_object: np.ndarray) -> tuple[Frame | None, str]:
        """The object's exact depth at a pose (4, 4) in the OpenCV camera frame, or None and the reason.

        Reasons: "too near" (nearer than the minimum depth), "out of view" (not wholly in the image), "too few points"
        (not even its bounding rectangle has `min_points` pixels).
        """
        if self._entity is None:
            raise RuntimeError("show() an object before photographing it")
        camera = self.intrinsics
        corners = self._outline @ T_camera_object[:3, :3].T + T_camera_object[:3, 3]
        if corners[:, 2].min() < camera.min_depth:
            return None, "too near"
        pixels = corners[:, :2] / corners[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        if low.min() < 0 or high[0] > camera.width or high[1] > camera.height:
            return None, "out of view"
        if np.prod(high - low) < self._config.min_points:
            return None, "too few points"
        pose = np.eye(4)
        pose[:3, :3] = SAPIEN_FROM_OPENCV @ T_camera_object[:3, :3]
        pose[:3, 3] = SAPIEN_FROM_OPENCV @ T_camera_object[:3, 3]
        self._entity.set_pose(sapien.Pose(pose))
        return self.draw(self.window(low, high)), ""

    def window(self, low: np.ndarray, high: np.ndarray) -> CameraIntrinsics:
        """The camera of the smallest window around the pixels from `low` to `high` (2,): column, row."""
        full = self.intrinsics
        # One more pixel on each side: what the noise model takes from neighbours must be there.
        corner = np.floor(low).astype(int) - 1
        size = np.ceil(high).astype(int) + 1 - corner
        width = min(next((side for side in _SIDES if side >= size[0]), full.width), full.width)
        height = min(next((side for side in _SIDES if side >= size[1]), full.height), full.height)
        column = int(np.clip(corner[0], 0, full.width - width))
        row = int(np.clip(corner[1], 0, full.height - height))
        return full.window(column, row, width, height)

    def draw(self, window: CameraIntrinsics) -> Frame:
        """The scene as it is, through a window."""
        camera = self._cameras.get((window.width, window.height))
        if camera is None:
            camera = add_depth_camera(self._scene, window)
            self._cameras[window.width, window.height] = camera
        set_intrinsics(camera, window)
        self._scene.update_render()
        return Frame(take_depth(camera), window)

    def measure(self, depth: np.ndarray, intrinsics: CameraIntrinsics, rng: np.random.Generator) -> np.ndarray:
        """What the configured sensor makes of an exact depth image."""
        if self._config.sensor == "d435":
            return apply_d435(depth, intrinsics, rng, self._config.noise)
        return apply_ideal(depth, intrinsics)
