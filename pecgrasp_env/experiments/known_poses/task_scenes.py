"""Frames of SelectiveGrasp-v1 scenes, as the robot's camera sees them before anything is moved, all poses known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from grasping.pose.object_model import ObjectModel
from pecgrasp_env.experiments.known_poses.cases import HALF_A_PIXEL, FrameCase, model_of
from pecgrasp_env.experiments.scene_clouds import look_from, scene_env
from pecgrasp_env.objects.mesh_folder import MeshFolder
from pecgrasp_env.policy.observation import read_observation
from pecgrasp_env.policy.perception import gripper_mask
from pecgrasp_env.policy.viewpoints import look_postures
from pecgrasp_env.scene.placement import PlacementError
from pecgrasp_env.scene.visibility import placed_mesh, visible_shares
from pecgrasp_env.sensor.intrinsics import deproject

__all__ = ["task_frames"]

_SEEDS_EACH = 3  # for a scene, at most
_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])


def task_frames(clutter: str, settings: Mapping[str, Any]) -> tuple[list[ObjectModel], Iterator[FrameCase]]:
    """The known models, and a frame of each scene of one `clutter`, from the first of the policy's places.

    settings: models, FOLDER/<class>/<instance> of the known; strangers, a folder of meshes, None: composed; n_objects,
    n_strangers, scenes, first_seed, sensor, resolution as the environment takes them. Where there are more objects than
    classes some are there twice. Raises ObjectError for folders that hold no such meshes, PlacementError where hardly
    any draw of so many objects fits on the table.
    """
    folder = MeshFolder(settings["models"], allow_open=True)
    models = {
        (label, name): model_of(folder, label, number)
        for label in folder.classes
        for number, name in enumerate(folder.names(label))
    }

    def frames() -> Iterator[FrameCase]:
        names = ("n_objects", "n_strangers", "strangers", "sensor", "resolution")
        env = scene_env(objects=folder, clutter=clutter, **{name: settings[name] for name in names})
        try:
            count, seed = 0, settings["first_seed"]
            while count < settings["scenes"]:
                try:
                    env.reset(seed=seed)
                except PlacementError:
                    # Such objects as were drawn do not fit on the table together; the next seed draws others.
                    if seed - settings["first_seed"] >= _SEEDS_EACH * settings["scenes"]:
                        raise
                else:
                    count += 1
                    yield _frame(env.unwrapped, f"{clutter}/{seed}", clutter, models)
                seed += 1
        finally:
            env.close()

    return list(models.values()), frames()


def _frame(task: Any, name: str, clutter: str, models: Mapping[tuple[str, str], ObjectModel]) -> FrameCase:
    observation, slot_of_pixel = look_from(task, look_postures()[0])
    seen = read_observation(observation)
    cloud = deproject(*seen.frame).astype(np.float64)
    cloud[~(cloud[..., 2] > 0) | gripper_mask(cloud, seen.opening, seen.T_tool0_camera)] = np.nan

    # Of the camera as it is, whose axes are OpenGL's here, not as the joint angles and the bracket say.
    cam2world_gl = observation["sensor_param"]["wrist_camera"]["cam2world_gl"][0].cpu().numpy()
    T_world_camera = cam2world_gl.astype(np.float64) @ _OPENCV
    T_camera_world = np.linalg.inv(T_world_camera)
    poses = [actor.pose.to_transformation_matrix()[0].cpu().numpy().astype(np.float64) for actor in task.objects]
    meshes = [
        placed_mesh(model, actor.pose.raw_pose[0].cpu().numpy())
        for model, actor in zip(task.models[0], task.objects, strict=True)
    ]
    visible = visible_shares(meshes, T_world_camera, seen.frame.intrinsics)
    known = [models.get((model.class_name, model.instance)) for model in task.models[0]]
    return FrameCase(
        name,
        clutter,
        cloud,
        seen.frame.intrinsics.matrix - HALF_A_PIXEL,
        slot_of_pixel + 1,
        tuple(None if model is None else model.name for model in known),
        np.stack([T_camera_world @ T for T in poses]),
        visible,
    )
