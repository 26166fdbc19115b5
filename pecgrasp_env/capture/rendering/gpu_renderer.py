"""Many depth frames at once on a GPU: ManiSkill's sub-scenes, each with a camera of its own.

`GpuRenderer` gives what `DepthRenderer` gives, in the same windows, so that labels, poses and draws are the same and a
cloud differs by no more than the rounding of another rasteriser. Never run: no GPU was at hand. Tests run it with
ManiSkill's CPU backend, which has one sub-scene. So it trusts itself as far as it can see: of every set of objects that
it shows, the first frame is compared with `DepthRenderer`'s, and where they differ that one takes over, with a warning.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import sapien
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.render.shaders import ShaderConfig
from mani_skill.sensors.camera import CameraConfig
from mani_skill.utils.structs import Pose

from pecgrasp_env.capture.rendering.depth_renderer import (
    OUT_OF_SIGHT,
    DepthRenderer,
    Extent,
    Frame,
    Shot,
    pose_of,
    window_around,
)
from pecgrasp_env.sensor import CameraIntrinsics
from pecgrasp_env.sensor.intrinsics import FAR, NEAR

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["GpuRenderer"]

_SAME_DEPTH = 1e-4  # m
_OTHER_PIXELS = 0.03  # share of them, on silhouettes, that may fall to the other side

_UNLIT_DEPTH = ShaderConfig(
    shader_pack="trivial",
    texture_names={"Position": ["depth"]},
    texture_transforms={"Position": lambda data: {"depth": -data[..., 2]}},  # OpenGL axes, metres
)


class GpuRenderer:
    """As many frames at once as there are sub-scenes; each sub-scene has all objects, and shows one of them."""

    def __init__(self, largest: float, cameras: Sequence[CameraIntrinsics], at_once: int, device: str = "cuda") -> None:
        """largest: m, as of DepthRenderer. cameras: those of all shots. device: "cuda", or "cpu" for at_once 1."""
        self.at_once = at_once
        self._cameras = list(cameras)
        self._backend = {
            "num_envs": at_once,
            "sim_backend": f"physx_{device}",
            "render_backend": f"sapien_{device}",
        }
        self._sub_scenes: _SubScenes | None = None
        self._given_up = False
        self._checked = False
        try:
            # A process draws on one device, that of its first renderer: that of DepthRenderer must not come first.
            self._first = sapien.render.RenderSystem(sapien.Device(device))
        except RuntimeError as error:
            self._give_up(str(error))
        self._renderer = DepthRenderer(largest)

    def check(self, model: ObjectModel) -> None:
        self._renderer.check(model)

    def show(self, models: Sequence[ObjectModel]) -> None:
        self._renderer.show(models)
        if self._given_up or (self._sub_scenes is not None and self._sub_scenes.models == list(models)):
            return
        self._checked = False
        try:
            if self._sub_scenes is None:
                self._sub_scenes = _SubScenes(models, self._cameras, self._backend)
            else:
                self._sub_scenes.models = list(models)
                self._sub_scenes.reset(options={"reconfigure": True})
        except RuntimeError as error:  # what SAPIEN and torch raise where a device is missing or full
            self._give_up(str(error))

    def extent(self, index: int, T_camera_object: np.ndarray, camera: CameraIntrinsics) -> Extent:
        return self._renderer.extent(index, T_camera_object, camera)

    def render_all(self, shots: Sequence[Shot]) -> list[Frame]:
        if self._sub_scenes is None:
            return self._renderer.render_all(shots)
        frames: dict[int, Frame] = {}
        for number, camera in enumerate(self._cameras):
            of_camera = [i for i, shot in enumerate(shots) if shot.camera == camera]
            for start in range(0, len(of_camera), self.at_once):
                chosen = of_camera[start : start + self.at_once]
                depths = self._sub_scenes.render_batch(number, [shots[i] for i in chosen])
                for i, depth in zip(chosen, depths, strict=True):
                    window = window_around(camera, shots[i].extent)
                    row, column = round(camera.cy - window.cy), round(camera.cx - window.cx)
                    frames[i] = Frame(depth[row : row + window.height, column : column + window.width], window)
        if not self._checked and shots:
            self._checked = True
            if not _alike(frames[0].depth, self._renderer.render(shots[0]).depth):
                self._give_up("its first frame is another than that of the renderer for single objects")
                return self._renderer.render_all(shots)
        return [frames[i] for i in range(len(shots))]

    def _give_up(self, why: str) -> None:
        warnings.warn(f"ManiSkill's batch is not used: {why}. Objects are drawn one by one", stacklevel=2)
        self._sub_scenes, self._given_up, self.at_once = None, True, 1


def _alike(depth: np.ndarray, other: np.ndarray) -> bool:
    surface = (depth > 0) | (other > 0)
    differ = np.abs(depth - other)[surface] > _SAME_DEPTH
    return bool(differ.sum() <= max(8, _OTHER_PIXELS * surface.sum()))


class _SubScenes(BaseEnv):
    """Sub-scenes without robot, floor or light: cameras at the origin, objects behind them until they are asked for."""

    def __init__(
        self, models: Sequence[ObjectModel], cameras: Sequence[CameraIntrinsics], backend: dict[str, Any]
    ) -> None:
        self.models = list(models)
        self._cameras = cameras
        super().__init__(obs_mode="none", reward_mode="none", robot_uids="none", **backend)

    @property
    def _default_sensor_configs(self) -> list[CameraConfig]:
        return [
            CameraConfig(
                uid=str(number),
                pose=sapien.Pose(),
                width=camera.width,
                height=camera.height,
                intrinsic=camera.matrix,
                near=NEAR,
                far=FAR,
                shader_config=_UNLIT_DEPTH,
            )
            for number, camera in enumerate(self._cameras)
        ]

    def _load_scene(self, options: dict[str, Any]) -> None:
        self.actors = []
        for number, model in enumerate(self.models):
            builder = model.add_to(self.scene.create_actor_builder(), collision=False)
            builder.initial_pose = OUT_OF_SIGHT
            self.actors.append(builder.build_kinematic(f"object {number}"))

    def _load_lighting(self, options: dict[str, Any]) -> None:
        pass  # depth needs none

    def get_state_dict(self) -> dict[str, Any]:
        return {}  # ManiSkill's would ask a robot, and there is none

    def render_batch(self, camera: int, shots: Sequence[Shot]) -> np.ndarray:
        """(n, H, W) float32 m, 0 where nothing is: of each shot the whole frame. At most one shot a sub-scene."""
        hidden = np.concatenate([OUT_OF_SIGHT.p, OUT_OF_SIGHT.q])
        for number, actor in enumerate(self.actors):
            poses = np.tile(hidden, (self.num_envs, 1))
            for place, shot in enumerate(shots):
                if shot.index == number:
                    pose = pose_of(shot.T_camera_object)
                    poses[place] = np.concatenate([pose.p, pose.q])
            actor.set_pose(Pose.create(torch.as_tensor(poses, dtype=torch.float32, device=self.device)))
        if self.gpu_sim_enabled:
            self.scene._gpu_apply_all()
            self.scene.px.gpu_update_articulation_kinematics()
            self.scene._gpu_fetch_all()
        self.scene.update_render(update_human_render_cameras=False)
        sensor = self.scene.sensors[str(camera)]
        sensor.capture()
        depth = sensor.get_obs(rgb=False, depth=True, position=False, segmentation=False)["depth"]
        return depth[: len(shots)].cpu().numpy()
