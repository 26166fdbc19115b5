"""A SAPIEN scene of many objects and boxes that renders depth and which of them each pixel shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import sapien

from pecgrasp_env.sensor.intrinsics import CameraIntrinsics
from pecgrasp_env.sensor.sapien_depth import SAPIEN_FROM_OPENCV, add_depth_camera, set_intrinsics, take_depth

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["SceneRenderer"]

_FAR_AWAY = sapien.Pose([0.0, 0.0, -1e3])
_COARSE = 4  # times fewer pixels along each side, where only areas are counted


class SceneRenderer:
    """No physics and no light; a scene stands still while cameras look at it."""

    def __init__(self) -> None:
        # SAPIEN's scene asks for a physics system when it ends; it is never stepped.
        self._scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
        self._cameras: dict[tuple[int, int], sapien.render.RenderCameraComponent] = {}
        self._objects: list[tuple[sapien.Entity, sapien.Pose]] = []
        self._boxes: list[sapien.Entity] = []
        self._labels: dict[int, int] = {}

    def show(
        self,
        models: Sequence[ObjectModel],
        poses: np.ndarray,
        boxes: Sequence[tuple[int, np.ndarray, sapien.Pose]],
        first_label: int,
    ) -> None:
        """Put a scene in place of the one before.

        Args:
            models: n objects, labelled first_label, first_label + 1, …
            poses: (n, 7), world frame, m and quaternion wxyz.
            boxes: label, half size (3,) m and pose of each.
            first_label: above 0, which is what nothing has.
        """
        for entity in [*self._boxes, *(entity for entity, _ in self._objects)]:
            self._scene.remove_entity(entity)
        sapien.render.clear_cache()  # SAPIEN keeps every mesh that it ever loaded
        self._objects, self._boxes, self._labels = [], [], {}
        for i, (model, pose) in enumerate(zip(models, poses, strict=True)):
            builder = model.add_to(self._scene.create_actor_builder(), collision=False)
            at = sapien.Pose(pose[:3], pose[3:])
            self._objects.append((self._add(builder, at, first_label + i), at))
        for label, half_size, pose in boxes:
            builder = self._scene.create_actor_builder()
            builder.add_box_visual(half_size=half_size)
            self._boxes.append(self._add(builder, pose, label))

    def render(self, T_world_camera: np.ndarray, intrinsics: CameraIntrinsics) -> tuple[np.ndarray, np.ndarray]:
        """Exact depth (H, W) float32 m, 0 where nothing is, and labels (H, W) uint8."""
        camera = self._camera(T_world_camera, intrinsics)
        self._scene.update_render()
        depth = take_depth(camera)
        return depth, self._label_of(camera)

    def visible_shares(self, T_world_camera: np.ndarray, intrinsics: CameraIntrinsics) -> np.ndarray:
        """Of each object the share, (n,) float32, of what the camera would see of it alone that it sees now.

        Counted at a quarter of the resolution; 0 for what is not in the image.
        """
        width, height = intrinsics.width // _COARSE, intrinsics.height // _COARSE
        fx, fy, cx, cy = intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy
        coarse = CameraIntrinsics(width, height, fx / _COARSE, fy / _COARSE, cx / _COARSE, cy / _COARSE)
        camera = self._camera(T_world_camera, coarse)
        seen = self._counts(camera)
        for entity, _ in self._objects:
            entity.set_pose(_FAR_AWAY)
        for box in self._boxes:
            box.find_component_by_type(sapien.render.RenderBodyComponent).disable()
        alone = np.zeros(len(self._objects))
        for i, (entity, pose) in enumerate(self._objects):
            entity.set_pose(pose)
            alone[i] = self._counts(camera)[i]
            entity.set_pose(_FAR_AWAY)
        for entity, pose in self._objects:
            entity.set_pose(pose)
        for box in self._boxes:
            box.find_component_by_type(sapien.render.RenderBodyComponent).enable()
        shares = np.divide(seen, alone, out=np.zeros(len(alone)), where=alone > 0)
        return np.minimum(shares, 1).astype(np.float32)

    def _counts(self, camera: sapien.render.RenderCameraComponent) -> np.ndarray:
        self._scene.update_render()
        camera.take_picture()
        labels = [self._labels[entity.per_scene_id] for entity, _ in self._objects]
        return np.bincount(self._label_of(camera).reshape(-1), minlength=256)[labels].astype(float)

    def _label_of(self, camera: sapien.render.RenderCameraComponent) -> np.ndarray:
        ids = camera.get_picture("Segmentation")[..., 1]
        table = np.zeros(int(ids.max(initial=0)) + 1, np.uint8)
        for entity, label in self._labels.items():
            if entity < len(table):
                table[entity] = label
        return table[ids]

    def _camera(self, T_world_camera: np.ndarray, intrinsics: CameraIntrinsics) -> sapien.render.RenderCameraComponent:
        size = intrinsics.width, intrinsics.height
        if size not in self._cameras:
            self._cameras[size] = add_depth_camera(self._scene, intrinsics)
        camera = self._cameras[size]
        set_intrinsics(camera, intrinsics)
        matrix = np.array(T_world_camera, float)
        matrix[:3, :3] = matrix[:3, :3] @ SAPIEN_FROM_OPENCV.T
        camera.entity.set_pose(sapien.Pose(matrix))
        return camera

    def _add(self, builder: sapien.ActorBuilder, pose: sapien.Pose, label: int) -> sapien.Entity:
        entity = sapien.Entity()
        entity.add_component(builder.build_render_component())
        entity.set_pose(pose)
        self._scene.add_entity(entity)
        self._labels[entity.per_scene_id] = label
        return entity
