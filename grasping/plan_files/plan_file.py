"""One file with a cloud → grasps: read, segment where it is a scene, plan on each object.

What a file holds never raises: its `error` says why it could not be read or planned on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.cloud_files import read_cloud, valid_points
from grasping.errors import CloudError, ConfigError
from grasping.grasp import GraspPlan, GraspPlanner
from grasping.gripper import Gripper
from grasping.plan_files.results import PlannedFile, PlannedObject
from grasping.segmentation.published import PublishedSegmenter
from grasping.segmentation.scene import Scene
from grasping.segmentation.segmenter import Segmenter
from grasping.validation import LARGEST_OBJECT, unit_vector

SURROUNDINGS = 0.12  # m around an object that are shown with it
FARTHEST_SCENE = 20.0  # m; no depth camera over a table sees half of its points beyond


@dataclass(frozen=True)
class Task:
    """How to plan on files.

    segmenter: each file is a whole scene, which it cuts into objects; None: each file is one object. up: (3,) away
    from the table in the clouds' frame; None: a table that is found says it, and without one the object's own axes
    stand for it. scale: metres in a unit of the files, 0.001 for millimetres.
    """

    planner: GraspPlanner
    gripper: Gripper
    segmenter: Segmenter | PublishedSegmenter | None = None
    up: ArrayLike | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        if isinstance(self.scale, bool) or not (isinstance(self.scale, (int, float)) and 0 < self.scale < math.inf):
            raise ConfigError(f"scale = {self.scale!r} must be a positive number, such as 0.001 for millimetres")
        if self.up is not None:
            unit_vector(self.up, name="up")


def plan_file(path: Path, task: Task) -> PlannedFile:
    """Read a file and plan on what is in it. Never raises for what the file holds."""
    started = time.perf_counter()
    try:
        cloud = read_cloud(path) * np.float32(task.scale)
        points = valid_points(cloud)
        read_s = time.perf_counter() - started
        _check_size(points, task)
    except (CloudError, OSError) as error:
        return PlannedFile(path, error=str(error).removeprefix(f"{path}: "))
    if task.segmenter is None:
        return PlannedFile(path, len(points), [_plan(task, path.name, points)], read_s=read_s)
    started = time.perf_counter()
    try:
        scene = task.segmenter.segment(cloud, up=task.up)
    except CloudError as error:
        return PlannedFile(path, len(points), read_s=read_s, error=str(error))
    segment_s = time.perf_counter() - started
    objects = [
        replace(
            _plan(
                task,
                f"object {k + 1}",
                scene.objects[k],
                table=scene.plane,
                obstacles=others,
                viewpoint=scene.viewpoint,
                unseen=scene.unseen[k],
            ),
            surroundings=_surroundings(cloud, scene, k),
            cut_off=scene.touches_border[k],
            confidence=scene.confidence[k] if scene.confidence else None,
        )
        for k, others in enumerate(_neighbours(scene))
    ]
    return PlannedFile(path, len(points), objects, scene, cloud.reshape(-1, 3), read_s, segment_s)


def _check_size(points: NDArray, task: Task) -> None:
    """Raises CloudError with the setting to change for a cloud whose size speaks of other units, or of a scene."""
    if not len(points):
        raise CloudError("it holds no valid point")
    if task.segmenter is None:
        span = float(np.ptp(points.astype(np.float64), axis=0).max())
        if span > LARGEST_OBJECT:
            raise CloudError(
                f"spans {span:.4g} m, too much for an object: say scale=0.001 if these are millimetres, "
                "scene=true if this is a whole scene"
            )
    else:
        distance = float(np.median(np.linalg.norm(points.astype(np.float64), axis=1)))
        if distance > FARTHEST_SCENE:
            raise CloudError(f"half of its points are beyond {distance:.4g} m: say scale=0.001 for millimetres")


def _neighbours(scene: Scene) -> Iterable[NDArray | None]:
    for k in range(len(scene.objects)):
        others = [points for i, points in enumerate(scene.objects) if i != k] + scene.obstacles
        yield np.vstack(others) if others else None


def _surroundings(cloud: NDArray, scene: Scene, k: int) -> NDArray:
    """The points that are not object k's, yet near to it."""
    points = cloud.reshape(-1, 3)
    low, high = scene.objects[k].min(axis=0) - SURROUNDINGS, scene.objects[k].max(axis=0) + SURROUNDINGS
    near = ((points >= low) & (points <= high)).all(axis=1)
    near[scene.indices[k]] = False
    return points[near]


def _plan(task: Task, name: str, points: NDArray, **scene: NDArray | None) -> PlannedObject:
    """scene: what the planner is told beside the cloud and `up`."""
    started = time.perf_counter()
    try:
        plan, error = task.planner.plan(points, up=task.up, **scene), None
    except (CloudError, ConfigError) as problem:
        plan, error = GraspPlan(None, [], [], str(problem)), str(problem)
    return PlannedObject(name, points, plan, time.perf_counter() - started, error=error)
