"""A SAPIEN scene that renders the depth of single objects: no physics, no lights, nothing else to draw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import sapien
from scipy.spatial import ConvexHull

from pecgrasp_env.capture.config import CaptureError
from pecgrasp_env.sensor import CameraIntrinsics
from pecgrasp_env.sensor.sapien_depth import SAPIEN_FROM_OPENCV, add_depth_camera, set_intrinsics, take_depth

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = [
    "OUT_OF_SIGHT",
    "DepthRenderer",
    "Extent",
    "Frame",
    "Renderer",
    "Shot",
    "gpu_draws",
    "pose_of",
    "window_around",
]

_SIDES = (32, 64, 96, 128, 192, 256, 384, 512, 768)
"""Widths and heights of windows, pixels: few enough to keep a camera for each, close enough to waste little."""

_SMALLEST = 0.005  # m

OUT_OF_SIGHT = sapien.Pose([-1e3, 0.0, 0.0])
"""Behind the camera, which stands at the scene's origin."""


@dataclass(frozen=True)
class Frame:
    """The part of a depth image that holds an object."""

    depth: np.ndarray
    """(h, w) float32 metres, exact; 0 where the object is not."""
    intrinsics: CameraIntrinsics


@dataclass(frozen=True)
class Extent:
    """Where an object at some pose would appear."""

    low: np.ndarray
    """(2,) smallest column and row of the image plane, pixels."""
    high: np.ndarray
    """(2,) largest column and row, pixels."""
    nearest: float
    """Least depth, metres."""

    def within(self, camera: CameraIntrinsics) -> bool:
        """Whether all of it is in the image."""
        return bool(self.low.min() >= 0 and self.high[0] <= camera.width and self.high[1] <= camera.height)


@dataclass(frozen=True)
class Shot:
    """A frame to be rendered of object `index`, alone, and what `extent` says of it."""

    index: int
    T_camera_object: np.ndarray
    camera: CameraIntrinsics
    extent: Extent


class Renderer(Protocol):
    """Renders exact depth frames of objects."""

    @property
    def at_once(self) -> int:
        """Frames that are worth asking for together."""

    def check(self, model: ObjectModel) -> None:
        """Raises CaptureError where an object is too large or too small to be captured."""

    def show(self, models: Sequence[ObjectModel]) -> None:
        """Put `models` before the camera, in place of the objects that were there. Raises CaptureError as `check`."""

    def extent(self, index: int, T_camera_object: np.ndarray, camera: CameraIntrinsics) -> Extent:
        """Where object `index` appears at a pose (4, 4) in the OpenCV camera frame."""

    def render_all(self, shots: Sequence[Shot]) -> list[Frame]:
        """The exact depth in a window around each shot's object, which is alone in it."""


class DepthRenderer:
    """Renders one object at a time with any depth camera.

    An empty scene shows nothing but the object, so only the window around it is drawn: a camera whose principal point
    is shifted by whole pixels sees the very rays of the full image. The frame is the same and several times faster.
    """

    at_once = 1

    def __init__(self, largest: float) -> None:
        """largest: m, the longest side that an object may have."""
        self._largest = largest
        # SAPIEN's scene asks for a physics system when it ends; it is never stepped.
        self._scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
        self._cameras: dict[tuple[int, int], sapien.render.RenderCameraComponent] = {}
        self._models: list[ObjectModel] = []
        self._entities: list[sapien.Entity] = []
        self._outlines: list[np.ndarray] = []

    def check(self, model: ObjectModel) -> None:
        """Raises CaptureError where an object is too large or too small to be captured."""
        size = float(model.extents.max())
        if not _SMALLEST <= size <= self._largest:
            raise CaptureError(
                f"{model.instance} is {size:.4g} m long; from {_SMALLEST} m up to {self._largest} m is possible. Is it "
                "in other units? objects.scale=0.001 turns millimetres into metres"
            )

    def show(self, models: Sequence[ObjectModel]) -> None:
        """Put `models` into the scene, in place of the objects that were there. Raises CaptureError as `check` does."""
        if len(models) == len(self._models) and all(a is b for a, b in zip(models, self._models, strict=True)):
            return
        for model in models:
            self.check(model)
        for entity in self._entities:
            self._scene.remove_entity(entity)
        self._models, self._entities, self._outlines = list(models), [], []
        sapien.render.clear_cache()  # SAPIEN keeps every mesh that it ever loaded
        for model in models:
            vertices = np.concatenate([part.vertices for part in model.parts]).astype(np.float64)
            # The hull's corners project onto the corners of the silhouette: they decide what is in view.
            self._outlines.append(vertices[ConvexHull(vertices).vertices])
            builder = model.add_to(self._scene.create_actor_builder(), collision=False)
            entity = sapien.Entity()
            entity.add_component(builder.build_render_component())
            entity.set_pose(OUT_OF_SIGHT)
            self._scene.add_entity(entity)
            self._entities.append(entity)

    def extent(self, index: int, T_camera_object: np.ndarray, camera: CameraIntrinsics) -> Extent:
        """Where object `index` appears at a pose (4, 4) in the OpenCV camera frame; all of it before the camera."""
        corners = self._outlines[index] @ T_camera_object[:3, :3].T + T_camera_object[:3, 3]
        nearest = float(corners[:, 2].min())
        if nearest <= 0:
            return Extent(np.full(2, -np.inf), np.full(2, np.inf), nearest)
        pixels = corners[:, :2] / corners[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
        return Extent(pixels.min(axis=0), pixels.max(axis=0), nearest)

    def render(self, shot: Shot) -> Frame:
        """The exact depth of one object, alone, in a window around it."""
        entity = self._entities[shot.index]
        entity.set_pose(pose_of(shot.T_camera_object))
        frame = self.render_window(window_around(shot.camera, shot.extent))
        if len(self._entities) > 1:
            entity.set_pose(OUT_OF_SIGHT)
        return frame

    def render_all(self, shots: Sequence[Shot]) -> list[Frame]:
        """One after the other: together they would be no faster."""
        return [self.render(shot) for shot in shots]

    def render_window(self, window: CameraIntrinsics) -> Frame:
        """The scene as it is, through a window."""
        camera = self._cameras.get((window.width, window.height))
        if camera is None:
            camera = add_depth_camera(self._scene, window)
            self._cameras[window.width, window.height] = camera
        set_intrinsics(camera, window)
        self._scene.update_render()
        return Frame(take_depth(camera), window)


def gpu_draws() -> bool:
    """Whether SAPIEN finds a GPU that draws and that CUDA reaches: what ManiSkill's batch needs."""
    try:
        return bool(sapien.Device("cuda").can_render())
    except RuntimeError:  # there is none
        return False


def pose_of(T_camera_object: np.ndarray) -> sapien.Pose:
    """An object's pose (4, 4) in the OpenCV camera frame as SAPIEN has it, whose cameras look along x."""
    pose = np.eye(4)
    pose[:3, :3] = SAPIEN_FROM_OPENCV @ T_camera_object[:3, :3]
    pose[:3, 3] = SAPIEN_FROM_OPENCV @ T_camera_object[:3, 3]
    return sapien.Pose(pose)


def window_around(camera: CameraIntrinsics, extent: Extent) -> CameraIntrinsics:
    """The camera of the smallest window around the part of an extent that is in the image."""
    full = np.array([camera.width, camera.height])
    # One more pixel on each side: what the noise model takes from neighbours must be there.
    corner = np.floor(np.clip(extent.low, 0, full)).astype(int) - 1
    size = np.ceil(np.clip(extent.high, 0, full)).astype(int) + 1 - corner
    width, height = (
        min(next((side for side in _SIDES if side >= wanted), most), most)
        for wanted, most in zip(size, full.tolist(), strict=True)
    )
    column, row = np.clip(corner, 0, full - (width, height)).tolist()
    return camera.window(column, row, width, height)
