"""What two arms know: their joints and grippers, the stand camera's frame, and how far to carry the thing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasping import Segmenter
from pecgrasp_env.policy.observation import RobotObservation, at, camera_frame
from pecgrasp_env.robot.collision_spheres import robot_spheres
from pecgrasp_env.robot.kinematics import UP
from pecgrasp_env.robot.two_arm_bases import ARMS, T_WORLD_BASE
from pecgrasp_env.sensor.intrinsics import deproject

CAMERA = "stand_camera"


@dataclass(frozen=True)
class DualObservation:
    """One moment. arms: of each its joints, opening and force; their frame is the one of the camera on the stand.
    T_world_camera: (4, 4), OpenCV axes. goal: (3,) m, world frame, how far the thing is to be carried.
    """

    arms: tuple[RobotObservation, RobotObservation]
    T_world_camera: np.ndarray
    goal: np.ndarray


@dataclass(frozen=True)
class Seen:
    """The thing between the arms, world frame. points: (M, 3) m. plane: the table (4,). viewpoint: (3,) m."""

    points: np.ndarray
    plane: np.ndarray
    viewpoint: np.ndarray


def read_dual_observation(obs: Mapping[str, Any]) -> DualObservation:
    """An observation of DualGrasp-v1 with depth. Raises ObservationError where a key is missing."""
    take = camera_frame(obs, CAMERA)
    openings = np.asarray(at(obs, "extra", "openings"), float).reshape(-1)
    forces = np.asarray(at(obs, "extra", "forces"), float).reshape(-1)
    qpos = [np.asarray(at(obs, "agent", name, "qpos"), float).reshape(-1)[:6] for name in ARMS]
    first, second = (RobotObservation(qpos[k], float(openings[k]), take, float(forces[k])) for k in range(2))
    T_camera_world = np.eye(4)
    T_camera_world[:3] = np.asarray(at(obs, "sensor_param", CAMERA, "extrinsic_cv"), float).reshape(-1, 4)[:3]
    goal = np.asarray(at(obs, "extra", "goal"), float).reshape(-1)
    return DualObservation((first, second), np.linalg.inv(T_camera_world), goal)


def look(observation: DualObservation, segmenter: Segmenter) -> Seen | None:
    """All that stands on the table but the arms: it is one thing, in however many pieces it is seen. None: nothing."""
    T = observation.T_world_camera
    up = T[:3, :3].T @ UP
    bodies = [
        robot_spheres(arm.q, arm.opening, np.linalg.inv(base) @ T)
        for arm, base in zip(observation.arms, T_WORLD_BASE, strict=True)
    ]
    frame = observation.arms[0].frame
    scene = segmenter.segment(deproject(*frame), up=up, robot=np.concatenate(bodies))
    if scene.plane is None or not scene.objects:
        return None
    points = np.concatenate(scene.objects).astype(float) @ T[:3, :3].T + T[:3, 3]
    normal = T[:3, :3] @ scene.plane[:3]
    return Seen(points, np.append(normal, scene.plane[3] - normal @ T[:3, 3]), T[:3, 3])
