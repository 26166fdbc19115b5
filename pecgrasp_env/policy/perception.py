"""What one depth frame shows: the objects, without the robot itself, and whether one of them is still there."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from grasping import ROBOTIQ_2F_140, Scene, Segmenter
from grasping.segmentation.scene import Cut
from pecgrasp_env.policy.observation import RobotObservation
from pecgrasp_env.policy.seen_objects import SeenObject
from pecgrasp_env.robot.kinematics import T_TOOL0_CAMERA, T_TOOL0_GRIPPER, UP
from pecgrasp_env.sensor.intrinsics import deproject

_GRIPPER_MARGIN_M = 0.015
_PLACE_CELL_M = 0.01  # in which an object's place on the table is compared
_ABOVE_TABLE_M = 0.006
_SUNK_M = 0.008  # more than an object that a hand has touched but not taken


@dataclass(frozen=True)
class View:
    """What one depth frame shows, in the base frame.

    objects: not yet classified. clouds: their points (M, 3) float32 in the camera frame, which classifiers take.
    pixels: (M,) of these points in the frame, row by row.
    plane: the table (4,) as n · p + d = 0, or None. obstacles: (K, 3) of what is no object but could be hit. cuts:
    pairs of the objects that adjoin, and how sure it is that they are two.
    """

    observation: RobotObservation
    objects: list[SeenObject]
    clouds: list[np.ndarray]
    pixels: list[np.ndarray]
    plane: np.ndarray | None
    obstacles: np.ndarray
    cuts: list[Cut] = field(default_factory=list)

    def with_pairs(self) -> View:
        """The same, and behind its objects each pair of those that adjoin as one: it was perhaps cut in two."""
        one, other = [cut.first for cut in self.cuts], [cut.second for cut in self.cuts]

        def both(each: list[np.ndarray]) -> list[np.ndarray]:
            return each + [np.concatenate([each[i], each[j]]) for i, j in zip(one, other, strict=True)]

        points, unseen = both([each.points for each in self.objects]), both([each.unseen for each in self.objects])
        joined = [
            SeenObject(
                points[len(self.objects) + k],
                self.objects[cut.first].touches_border or self.objects[cut.second].touches_border,
                [],
                self.objects[cut.first].viewpoints,
                unseen[len(self.objects) + k],
                1.0 - cut.sure,
            )
            for k, cut in enumerate(self.cuts)
        ]
        return replace(self, objects=self.objects + joined, clouds=both(self.clouds), pixels=both(self.pixels), cuts=[])

    @cached_property
    def surface(self) -> np.ndarray:
        """(N, 3) of all that the frame shows, but the gripper."""
        cloud = _without_gripper(self.observation).reshape(-1, 3)
        return _moved(self.observation.T_base_camera, cloud[np.isfinite(cloud[:, 2])])


def gripper_mask(points_camera: np.ndarray, opening: float, T_tool0_camera: np.ndarray = T_TOOL0_CAMERA) -> np.ndarray:
    """(…,) bool: points (…, 3) of the camera frame that may lie on the gripper or on what it holds."""
    T_gripper_camera = np.linalg.inv(T_TOOL0_GRIPPER) @ T_tool0_camera
    R, t = T_gripper_camera[:3, :3], T_gripper_camera[:3, 3]
    hand = ROBOTIQ_2F_140
    tip = hand.pad_depth(opening) + hand.pad_length / 2 + _GRIPPER_MARGIN_M
    half_hinge = max(hand.finger_width / 2, 0.04) + _GRIPPER_MARGIN_M  # the palm is a can of 40 mm radius
    half_closing = max(opening / 2 + 0.03, 0.06) + _GRIPPER_MARGIN_M
    low, high = np.array([-half_hinge, -half_closing, 0.0]), np.array([half_hinge, half_closing, tip])
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    depths = ((corners - t) @ R)[:, 2]
    # Most of a frame lies behind the whole gripper: its depth alone says so.
    mask = (points_camera[..., 2] > depths.min() - 1e-6) & (points_camera[..., 2] < depths.max() + 1e-6)
    p = points_camera[mask] @ R.T + t
    mask[mask] = ((p > low) & (p < high)).all(axis=-1)
    return mask


def segment_frame(observation: RobotObservation, segmenter: Segmenter) -> Scene:
    """The objects in one depth frame, in the camera frame; `indices` are those of its pixels, row by row."""
    up = observation.T_base_camera[:3, :3].T @ UP
    return segmenter.segment(deproject(*observation.frame), up=up, robot=observation.robot)


def _without_gripper(observation: RobotObservation) -> np.ndarray:
    """(H, W, 3) in the camera frame, NaN where nothing was measured, or the gripper and what it holds."""
    cloud = deproject(*observation.frame)
    if observation.knows_gripper:
        cloud[gripper_mask(cloud, observation.opening, observation.T_tool0_camera)] = np.nan
    return cloud


def look(observation: RobotObservation, segmenter: Segmenter) -> View:
    """The objects in one depth frame, the table under them, and what else could be hit."""
    scene = segment_frame(observation, segmenter)
    T = observation.T_base_camera
    objects = [
        SeenObject(_moved(T, points), bool(border), [], T[None, :3, 3], _moved(T, unseen), certainty)
        for points, border, unseen, certainty in zip(
            scene.objects, scene.touches_border, scene.unseen, scene.certainties(), strict=True
        )
    ]
    plane = None
    if scene.plane is not None:
        normal = T[:3, :3] @ scene.plane[:3]
        plane = np.append(normal, scene.plane[3] - normal @ T[:3, 3])
    obstacles = np.concatenate([np.zeros((0, 3)), *(_moved(T, points) for points in scene.obstacles)])
    return View(observation, objects, list(scene.objects), list(scene.indices), plane, obstacles, scene.cuts)


def _moved(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.asarray(points, float) @ T[:3, :3].T + T[:3, 3]


def still_there(seen: SeenObject, observation: RobotObservation, plane: np.ndarray | None) -> bool:
    """Whether an object lies where it was seen before: most of its place, as far as it is in sight now, is covered by
    something no higher than it, and nearly as high.
    """
    normal, offset = (UP, 0.0) if plane is None else (plane[:3], plane[3])
    cloud = _without_gripper(observation)
    now = _moved(observation.T_base_camera, cloud[np.isfinite(cloud[..., 2])])
    height, height_then = now @ normal + offset, seen.points @ normal + offset
    in_sight = height < height_then.max() + _PLACE_CELL_M

    def tops(points: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The cells of the table over which points are, as numbers, and how high they reach there."""
        cells = np.floor(points[:, :2] / _PLACE_CELL_M).astype(np.int64) @ [1_000_003, 1]
        place, index = np.unique(cells, return_inverse=True)
        top = np.full(len(place), -np.inf)
        np.maximum.at(top, index.reshape(-1), heights)
        return place, top

    place, top_then = tops(seen.points, height_then)
    place_now, top_now = tops(now[in_sight], height[in_sight])
    _, then, at_present = np.intersect1d(place, place_now, return_indices=True)
    # What lay on another object leaves that one's surface in its place.
    covered = top_now[at_present] > np.maximum(_ABOVE_TABLE_M, top_then[then] - _SUNK_M)
    return bool(len(then) > 0.3 * len(place) and covered.sum() > 0.6 * len(then))
