"""Exact float depth out of a bare SAPIEN camera.

ManiSkill and SAPIEN's "minimal" shader route depth through the image `PositionSegmentation`, which is int16
millimetres, cut towards zero. The "trivial" shader draws colour, float32 position and segmentation without any light,
in one pass; its depth buffer is the float32 image `GbufferDepth`, a quarter as large as `Position`. With the
projection undone, that is the depth along the optical axis, with an error below z² · 2⁻²³ / NEAR: 10 µm at 2 m. A frame
of 424x240 with three objects takes about 1 ms with Mesa's software driver, beside 2.5 ms with "minimal" and 10 ms with
"default".
"""

from __future__ import annotations

import numpy as np
import sapien

from pecgrasp_env.sensor.intrinsics import FAR, NEAR, CameraIntrinsics

__all__ = ["SAPIEN_FROM_OPENCV", "add_depth_camera", "linear_depth", "set_intrinsics", "take_depth"]

SAPIEN_FROM_OPENCV = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""(3, 3) rotation: camera axes of OpenCV (x right, y down, z forward) → SAPIEN's (x forward, y left, z up)."""


def add_depth_camera(scene: sapien.Scene, intrinsics: CameraIntrinsics) -> sapien.render.RenderCameraComponent:
    """Adds a camera at the scene's origin that `take_depth` can read."""
    sapien.render.set_camera_shader_dir("trivial")  # a global setting of SAPIEN's for the cameras that are added next
    camera = scene.add_camera("depth", intrinsics.width, intrinsics.height, 1.0, NEAR, FAR)
    set_intrinsics(camera, intrinsics)
    return camera


def set_intrinsics(camera: sapien.render.RenderCameraComponent, intrinsics: CameraIntrinsics) -> None:
    """Gives the camera other focal lengths and another principal point; the size of its image stays."""
    camera.set_perspective_parameters(NEAR, FAR, intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, 0.0)


def take_depth(camera: sapien.render.RenderCameraComponent) -> np.ndarray:
    """Draws the scene as of its last `update_render` → (H, W) float32 metres, 0 where nothing is."""
    camera.take_picture()
    return linear_depth(camera.get_picture("GbufferDepth"))


def linear_depth(buffer: np.ndarray) -> np.ndarray:
    """Vulkan's depth buffer, float32 in [0, 1] → metres along the optical axis, 0 where nothing was drawn."""
    depth = np.float32(NEAR * FAR) / (np.float32(FAR) - buffer * np.float32(FAR - NEAR))
    return np.where(buffer < 1, depth, np.float32(0))
