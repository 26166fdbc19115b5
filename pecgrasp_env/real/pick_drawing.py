"""What a look and a plan show, as points and words in the base frame: for the page and for the live view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from grasping import ROBOTIQ_2F_140, Grasp
from pecgrasp_env.policy.planned_pick import PlannedPick
from pecgrasp_env.policy.seen_objects import SeenObject
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.kinematics import T_TOOL0_GRIPPER, forward_kinematics
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics, deproject

_BETWEEN_RAD = 0.02  # of two points of a drawn path
_FARTHEST_M = 1.5  # of what is drawn, from the camera


def scene_points(depth: np.ndarray, intrinsics: CameraIntrinsics, T_base_camera: np.ndarray) -> np.ndarray:
    """(N, 3) m, base frame: all that a depth frame (H, W), m, shows."""
    cloud = deproject(np.where(depth < _FARTHEST_M, depth, 0), intrinsics).reshape(-1, 3)
    seen = cloud[np.isfinite(cloud).all(axis=1) & (cloud[:, 2] > 0)]
    return seen @ T_base_camera[:3, :3].T + T_base_camera[:3, 3]


def words_of(objects: Sequence[SeenObject]) -> list[str]:
    """What each thing is taken for, with its probability."""
    words = []
    for seen in objects:
        shares = seen.probabilities()
        label = max(shares, key=lambda name: shares[name])
        words.append(f"{label} {100 * shares[label]:.0f} %")
    return words


def tips_along(path: np.ndarray, opening: float, arm: ArmLengths = UR5) -> np.ndarray:
    """(N, 3) m, base frame: the middle between the fingertips along joint waypoints (K, 6), rad, at an opening, m."""
    steps = np.abs(np.diff(path, axis=0)).max(axis=1, initial=0.0)
    at = np.concatenate([[0.0], np.cumsum(steps)])
    places = np.linspace(0.0, at[-1], 2 + int(at[-1] / _BETWEEN_RAD))
    dense = np.stack([np.interp(places, at, joint) for joint in path.T], axis=1)
    tip = np.array([0.0, 0.0, float(ROBOTIQ_2F_140.pad_depth(opening)) + ROBOTIQ_2F_140.pad_length / 2, 1.0])
    return np.array([(forward_kinematics(q, arm) @ T_TOOL0_GRIPPER @ tip)[:3] for q in dense])


def chosen_grasp(pick: PlannedPick) -> Grasp | None:
    """As it is carried out, base frame; None where there is none."""
    if pick.plan is None or pick.plan.best is None or pick.T_base_grasp is None:
        return None
    grasp = pick.plan.best if pick.approach is None else pick.approach.grasp
    return Grasp(pick.T_base_grasp, grasp.width, grasp.score, grasp.kind, grasp.region, grasp.terms)


def planned_way(pick: PlannedPick) -> np.ndarray:
    """(N, 3) m, base frame: the fingertips' middle on the way to the grasp and up; none where none is planned."""
    if pick.approach is None:
        return np.empty((0, 3))
    approach = pick.approach
    path = np.concatenate([approach.to_pregrasp, approach.to_grasp, approach.to_lift])
    return tips_along(path, approach.opening, approach.arm)
