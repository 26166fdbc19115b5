"""Labelled clouds as the robot gets them: cut out of SelectiveGrasp-v1 scenes by the environment's own pipeline.

Nothing here is shared with the generation of training data but the catalogue: the environment lays the scene out, draws
it, adds the sensor's faults; the policy's perception cuts it out; the environment's segmentation picture labels it. So
what a classifier scores on these clouds is what it will score in an episode.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch

from grasping import Segmenter
from pec.data.shards import (
    MANIFEST_NAME,
    CloudSample,
    Manifest,
    ShardRecord,
    read_manifest,
    shard_name,
    write_manifest,
    write_shard,
)
from pec.errors import DatasetError
from pecgrasp_env.objects import LARS_CLASSES, open_objects
from pecgrasp_env.policy.observation import read_observation
from pecgrasp_env.policy.perception import segment_frame
from pecgrasp_env.policy.viewpoints import look_postures

__all__ = ["capture_scenes", "look_from", "scene_env"]

_MIN_POINTS = 64  # what the published network takes; the policy does not classify smaller cut-outs
_MIN_SHARE = 0.5  # of a cut-out's points on objects, for it to be called one of them


def capture_scenes(
    settings: Mapping[str, Any],
    directory: str | os.PathLike[str],
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Write a data set of the cut-outs of `settings["scenes"]` scenes, or what is missing of it; returns `directory`.

    settings: first_seed, scenes, n_objects, sensor, resolution, and objects, arguments of `open_objects`. One shard a
    scene; every scene is looked at from all of the policy's postures. What the image cuts off is left out, as the
    policy does not choose it, and so is what has fewer than 64 points. progress(done, total) counts scenes.
    Raises DatasetError where `directory` holds another set.
    """
    directory = Path(directory)
    source = open_objects(**settings["objects"])
    classes = list(settings["objects"].get("classes") or LARS_CLASSES)
    instances = [{"name": name, "class": each} for each in classes for name in source.names(each)]
    index = {(instance["class"], instance["name"]): i for i, instance in enumerate(instances)}
    cameras = [{"name": f"the policy's view {k + 1}"} for k in range(len(look_postures()))]
    manifest = Manifest(classes, instances, cameras, dict(settings), settings["first_seed"], {})
    if (directory / MANIFEST_NAME).is_file():
        found = read_manifest(directory)
        if (found.config, found.instances) != (manifest.config, manifest.instances):
            raise DatasetError(f"{directory} holds clouds of other scenes: give another folder, or remove it")
        manifest = found
    missing = range(len(manifest.shards), settings["scenes"])
    if not missing:
        return directory
    chosen = {name: settings[name] for name in ("n_objects", "sensor", "resolution")}
    env = scene_env(objects=source, classes=classes, **chosen)
    try:
        for number in missing:
            seed = settings["first_seed"] + number
            samples, rejected = _scene(env, seed, classes, index)
            record = write_shard(directory / shard_name(number), samples)
            record = ShardRecord(record.file, record.n_samples, record.sha256, dict(sorted(rejected.items())))
            done = number + 1 == settings["scenes"]
            manifest = replace(manifest, shards=[*manifest.shards, record], complete=done)
            write_manifest(directory, manifest)
            if progress is not None:
                progress(number + 1, settings["scenes"])
    finally:
        env.close()
    return directory


def scene_env(**settings: Any) -> gym.Env:
    """SelectiveGrasp-v1 with the pictures that `look_from` takes; settings as the environment takes them."""
    return gym.make(
        "SelectiveGrasp-v1",
        obs_mode="depth+segmentation",
        control_mode="pd_joint_pos",
        sim_backend="physx_cpu",
        render_backend="cpu",
        **settings,
    )


def look_from(task: Any, posture: np.ndarray) -> tuple[dict[str, Any], np.ndarray]:
    """What is observed with the arm in a posture (6,) rad, and the number (H, W) of each pixel's object, or −1."""
    q = task.agent.robot.get_qpos().clone()
    q[0, :6] = torch.as_tensor(posture)
    task.agent.robot.set_qpos(q)
    observation = task.get_obs()
    pictured = observation["sensor_data"]["wrist_camera"]["segmentation"][0, ..., 0].cpu().numpy()
    slot_of_pixel = np.full(pictured.shape, -1)
    for slot, actor in enumerate(task.objects):
        slot_of_pixel[pictured == int(actor.per_scene_id[0])] = slot
    return observation, slot_of_pixel


def _scene(
    env: gym.Env, seed: int, classes: list[str], index: Mapping[tuple[str, str], int]
) -> tuple[list[CloudSample], Counter[str]]:
    task: Any = env.unwrapped
    env.reset(seed=seed)
    segmenter, rejected, samples = Segmenter(), Counter[str](), []
    for view, posture in enumerate(look_postures()):
        observation, slot_of_pixel = look_from(task, posture)
        seen = read_observation(observation)
        scene = segment_frame(seen, segmenter)
        T_camera_base = np.linalg.inv(seen.T_base_camera)
        for points, indices, border in zip(scene.objects, scene.indices, scene.touches_border, strict=True):
            slots = slot_of_pixel.reshape(-1)[indices]
            counts = np.bincount(slots[slots >= 0], minlength=len(task.objects))
            if border or len(points) < _MIN_POINTS or not counts.any():
                rejected["out of view" if border else "too few points" if counts.any() else "nothing"] += 1
                continue
            slot, purity = int(counts.argmax()), float(counts.max() / counts.sum())
            if purity < _MIN_SHARE:
                rejected["mixed"] += 1
                continue
            model = task.models[0][slot]
            T = T_camera_base @ task.objects[slot].pose.to_transformation_matrix()[0].cpu().numpy()
            label = classes.index(model.class_name), index[model.class_name, model.instance]
            samples.append(CloudSample(points, *label, T, seed, view, 0.0, purity))
    return samples, rejected
