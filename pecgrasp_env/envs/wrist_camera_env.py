"""What a task shows: its camera, on the wrist or elsewhere, through its sensor, lazily where wished, or as a cloud."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import cache, cached_property, partial
from typing import Any, ClassVar, Protocol

import numpy as np
import torch
from gymnasium import spaces
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils import common
from mani_skill.utils.gym_utils import convert_observation_to_space

from pecgrasp_env.envs.cloud_observation import sample_cloud
from pecgrasp_env.envs.lazy_images import LazyImages
from pecgrasp_env.envs.observation_bounds import bounded, flat_bounds
from pecgrasp_env.envs.validation import SensingOptions, TaskError
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics
from pecgrasp_env.sensor.maniskill_camera import CAMERA, camera_overrides, sense
from pecgrasp_env.sensor.sapien_depth import SAPIEN_FROM_OPENCV

NOISE = 2  # number of the sensor's stream of random numbers among an episode's


class HasNoiseSeed(Protocol):
    """What a task remembers, as far as its sensor is concerned: the seed of an episode's noise, (N,) long."""

    noise_seed: torch.Tensor


class WristCameraEnv(BaseEnv):
    """A ManiSkill environment whose depth comes from the sensor model of its camera, the wrist camera by default.

    ``sensing`` and ``memory`` are the task's; call `_camera_arguments` before `BaseEnv.__init__`.
    """

    camera_name: ClassVar[str] = CAMERA

    # Set to True, visual observations hold `LazyImages`, the same ones: each is rendered if and when it is read, which
    # must be before the next step. For whoever reads them seldom, as the scripted policy; wrappers that copy read all.
    pictures_on_demand = False
    sensing: SensingOptions
    memory: HasNoiseSeed
    _only_cloud: bool
    _shown: dict[str, LazyImages]
    _intrinsics: CameraIntrinsics
    _T_link_camera: np.ndarray  # (4, 4), OpenCV axes, both

    def _camera_arguments(
        self, obs_mode: str | None, shader_dir: str | None, sensor_configs: Mapping[str, Any] | None
    ) -> dict[str, Any]:
        """ManiSkill's ``sensor_configs`` with the camera in it as ``sensing`` wants it, and what the task has to
        know of it.

        Raises TaskError where there is no such camera, or it has fewer pixels than the cloud has points; SensorError as
        `camera_overrides` does.
        """
        self._only_cloud = obs_mode == "cloud"
        self._shown = {}
        # Light is computed only where colour is observed; point clouds carry the plain colours.
        textures = {"rgbd": ["rgb"], "pointcloud": []}.get(obs_mode or "", (obs_mode or "").split("+"))
        shader = {} if shader_dir is None else {"shader_pack": shader_dir}
        self._intrinsics, camera, others = camera_overrides(
            self.sensing.intrinsics, textures, shader | dict(sensor_configs or {}), self.camera_name
        )
        if others and type(self)._default_sensor_configs is BaseEnv._default_sensor_configs:
            raise TaskError(f"sensor_configs: no camera {', '.join(others)}, there is {self.camera_name!r}")
        self._T_link_camera = np.eye(4)
        if "pose" in camera:
            self._T_link_camera[:3] = camera["pose"].to_transformation_matrix()[:3]
            self._T_link_camera[:3, :3] = self._T_link_camera[:3, :3] @ SAPIEN_FROM_OPENCV
        if self._only_cloud and self.sensing.cloud_points > self._intrinsics.width * self._intrinsics.height:
            size = f"{self._intrinsics.width}x{self._intrinsics.height}"
            raise TaskError(f"cloud_points={self.sensing.cloud_points}: a picture of {size} has fewer pixels")
        # ManiSkill's shaders have depth in whole millimetres; so other cameras, too, take this one's.
        return {"shader_config": camera["shader_config"], self.camera_name: camera, **others}

    @property
    def obs_mode(self) -> str:
        return "cloud" if self._only_cloud else self._obs_mode

    def _get_obs_with_sensor_data(self, info: dict, apply_texture_transforms: bool = True) -> dict:
        if self.pictures_on_demand and apply_texture_transforms:
            observation = {
                "agent": self._get_obs_agent(),
                "extra": self._get_obs_extra(info),
                "sensor_param": self.get_sensor_params(),
                "sensor_data": self._lazy_images(),
            }
        else:
            observation = super()._get_obs_with_sensor_data(info, apply_texture_transforms)
        if not self._only_cloud:
            return observation
        depth = observation.pop("sensor_data")[self.camera_name]["depth"]
        camera = observation.pop("sensor_param")[self.camera_name]
        cloud = sample_cloud(
            depth[..., 0],
            camera["intrinsic_cv"],
            camera["cam2world_gl"] @ torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0], device=self.device)),
            self.memory.noise_seed,
            self._elapsed_steps,
            self.sensing.cloud_points,
        )
        return {**observation, "cloud": cloud}

    def _lazy_images(self) -> dict[str, LazyImages]:
        """Each sensor's images of this moment, not yet rendered; those of the moment before can be had no more."""
        for images in self._shown.values():
            images.expire()
        rendered = cache(self._get_obs_sensor_data)
        visual = asdict(self.obs_mode_struct.visual)
        kinds = [kind for kind, wanted in visual.items() if wanted]
        self._shown = {
            name: LazyImages(kinds, partial(lambda sensor: rendered()[sensor], name)) for name in self._sensors
        }
        return dict(self._shown)

    @cached_property
    def single_observation_space(self) -> spaces.Space:
        if self._obs_mode == "state":
            low, high = flat_bounds(self.get_obs(unflattened=True), self.control_freq)
            if low.shape == self._init_raw_obs.shape[1:]:
                return spaces.Box(low, high, dtype=np.float32)
        space = convert_observation_to_space(common.to_numpy(self._init_raw_obs), unbatched=True)
        return bounded(space, self.control_freq)

    def _get_obs_sensor_data(self, apply_texture_transforms: bool = True) -> dict:
        data = super()._get_obs_sensor_data(apply_texture_transforms)
        if not apply_texture_transforms:
            return data
        for name, images in data.items():
            if "depth" in images or "position" in images:
                # One generator for each image, so that looking twice at one moment shows the same.
                generators = [
                    np.random.default_rng([NOISE, int(seed), int(step)])
                    for seed, step in zip(self.memory.noise_seed, self.elapsed_steps, strict=True)
                ]
                data[name] = sense(images, self._sensors[name], self.sensing.sensor, generators)
        return data
