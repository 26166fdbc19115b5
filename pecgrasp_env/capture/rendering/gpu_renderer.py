"""Many depth pictures at once on a GPU: ManiSkill's sub-scenes, each with a camera of its own.

`BatchStudio` gives what `DepthStudio` gives, in the same windows, so that labels, poses and draws are the same and a
cloud differs by no more than the rounding of another rasteriser. It has run with ManiSkill's CPU backend, which has one
sub-scene, and never yet on a GPU. So it trusts itself as far as it can see: of every set of objects that it shows, the
first picture is compared with the studio's, and where they differ the studio takes over, with a warning.
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
    DepthStudio,
    Extent,
    Frame,
    Shot,
    pose_of,
    window_around,
)
from pecgrasp_env.sensor import CameraIntrinsics
from pecgrasp_env.sensor.sapien_depth import FAR, NEAR

if TYPE_CHECKING:
    from pecgrasp_env.objects import ObjectModel

__all__ = ["BatchStudio"]

_SAME_DEPTH = 1e-4  # m
_OTHER_PIXELS = 0.03  # share of them, on silhouettes, that may fall to the other side

_UNLIT_DEPTH = ShaderConfig(
    shader_pack="trivial",
    texture_names={"Position": ["depth"]},
    texture_transforms={"Position": lambda data: {"depth": -data[..., 2]}},  # OpenGL axes, metres
)


class BatchStudio:
    """As many pictures at once as there are sub-scenes; each sub-scene has all objects, and shows one of them."""

    def __init__(self, largest: float, cameras: Sequence[CameraIntrinsics], at_once: int, device: str = "cuda") -> None:
        """largest: m, as of DepthStudio. cameras: all that a shot may name. device: "cuda", or "cpu" for at_once 1."""
        self.at_once = at_once
        self._cameras = list(cameras)
        self._backend = {
            "num_envs": at_once,
            "sim_backend": f"physx_{device}",
            "render_backend": f"sapien_{device}",
        }
        self._booths: _Booths | None = None
        self._given_up = False
        self._checked = False
        try:
            # A process draws on one device, that of its first renderer: the studio's must not come first.
            self._first = sapien.render.RenderSystem(sapien.Device(device))
        except RuntimeError as error:
            self._give_up(str(error))
        self._studio = DepthStudio(largest)

    def check(self, model: ObjectModel) -> None:
        self._studio.check(model)

    def show(self, models: Sequence[ObjectModel]) -> None:
        self._studio.show(models)
        if self._given_up or (self._booths is not None and self._booths.models == list(models)):
            return
        self._checked = False
        try:
            if self._booths is None:
                self._booths = _Booths(models, self._cameras, self._backend)
            else:
                self._booths.models = list(models)
                self._booths.reset(options={"reconfigure": True})
        except RuntimeError as error:  # what SAPIEN and torch raise where a device is missing or full
            self._give_up(str(error))

    def extent(self, index: int, T_camera_object: np.ndarray, camera: CameraIntrinsics) -> Extent:
        return self._studio.extent(index, T_camera_object, camera)

    def photograph_all(self, shots: Sequence[Shot]) -> list[Frame]:
        if self._booths is None:
            return self._studio.photograph_all(shots)
        frames: dict[int, Frame] = {}
        for number, camera in enumerate(self._cameras):
            of_camera = [i for i, shot in enumerate(shots) if shot.camera == camera]
            for start in range(0, len(of_camera), self.at_once):
                chosen = of_camera[start : start + self.at_once]
                pictures = self._booths.take(number, [shots[i] for i in chosen])
                for i, picture in zip(chosen, pictures, strict=True):
                    window = window_around(camera, shots[i].extent)
                    row, column = round(camera.cy - window.cy), round(camera.cx - window.cx)
                    frames[i] = Frame(picture[row : row + window.height, column : column + window.width], window)
        if not self._checked and shots:
            self._checked = True
            if not _alike(frames[0].depth, self._studio.photograph(shots[0]).depth):
                self._give_up("its first picture is another than that of the renderer for single objects")
                return self._studio.photograph_all(shots)
        return [frames[i] for i in range(len(shots))]

    def _give_up(self, why: str) -> None:
        warnings.warn(f"ManiSkill's batch is not used: {why}. Objects are drawn one by one", stacklevel=2)
        self._booths, self._given_up, self.at_once = None, True, 1


def _alike(picture: np.ndarray, other: np.ndarray) -> bool:
    surface = (picture > 0) | (other > 0)
    differ = np.abs(picture - other)[surface] > _SAME_DEPTH
    return bool(differ.sum() <= max(8, _OTHER_PIXELS * surface.sum()))


class _Booths(BaseEnv):
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

    def take(self, camera: int, shots: Sequence[Shot]) -> np.ndarray:
        """(n, H, W) float32 m, 0 where nothing is: of each shot the whole picture. At most one shot a sub-scene."""
        hidden = np.concatenate([OUT_OF_SIGHT.p, OUT_OF_SIGHT.q])
        for number, actor in enumerate(self.actors):
            poses = np.tile(hidden, (self.num_envs, 1))
            for booth, shot in enumerate(shots):
                if shot.index == number:
                    pose = pose_of(shot.T_camera_object)
                    poses[booth] = np.concatenate([pose.p, pose.q])
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
