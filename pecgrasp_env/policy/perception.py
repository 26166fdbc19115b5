"""What the policy sees: one observation read as a real robot would have it, and the objects on the table with their
classes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from grasping import ROBOTIQ_2F_140, Scene, Segmenter
from pecgrasp_env.robot import T_TOOL0_CAMERA, T_TOOL0_GRIPPER, forward_kinematics
from pecgrasp_env.robot.kinematics import UP
from pecgrasp_env.sensor import CameraIntrinsics, deproject

OTHER = "something else"  # what a classifier that names one class leaves to all others
_SAME_OBJECT_M = 0.04  # centroids of one object in two views lie no further apart, those of two objects do
_GRIPPER_MARGIN_M = 0.015
_PLACE_CELL_M = 0.01  # in which an object's place on the table is compared
_ABOVE_TABLE_M = 0.006


class ObservationError(ValueError):
    """The observation lacks what the policy needs; the message names the key."""


class Picture(NamedTuple):
    """depth: (H, W) float32 m along the optical axis, 0 for none."""

    depth: np.ndarray
    intrinsics: CameraIntrinsics


@dataclass(frozen=True)
class Percept:
    """One observation: joint angles (6,) rad, gripper opening m, the camera's picture, and the force between the pads,
    N, where the gripper tells it.

    take: takes the picture, at the first look. camera: T_base_camera (4, 4) where it is known otherwise than from the
    joint angles. shows_gripper: whether the camera sits on the bracket, so that the gripper may be in its picture.
    """

    q: np.ndarray
    opening: float
    take: Callable[[], Picture]
    force: float | None = None
    camera: np.ndarray | None = None
    shows_gripper: bool = True

    @cached_property
    def picture(self) -> Picture:
        """Taken once."""
        return self.take()

    @property
    def T_base_camera(self) -> np.ndarray:
        """From the joint angles and the bracket's calibration, as on a real robot, unless it is given."""
        return forward_kinematics(self.q) @ T_TOOL0_CAMERA if self.camera is None else self.camera


def read_observation(obs: Mapping[str, Any]) -> Percept:
    """A visual observation of SelectiveGrasp-v1 with depth, batched with one sub-environment or not batched.

    Raises:
        ObservationError: a key is missing, or there is more than one sub-environment.
    """
    pictures = _at(obs, "sensor_data", "wrist_camera")
    if "depth" not in pictures:
        raise ObservationError("obs has no sensor_data/wrist_camera/depth: use an obs_mode with depth")
    qpos = np.atleast_2d(np.asarray(_at(obs, "agent", "qpos"), float))
    if len(qpos) != 1:
        raise ObservationError(f"obs holds {len(qpos)} sub-environments: the policy drives one robot")
    K = np.asarray(_at(obs, "sensor_param", "wrist_camera", "intrinsic_cv"), float).reshape(3, 3)

    def take() -> Picture:
        depth = np.asarray(pictures["depth"], np.float32)
        height, width = depth.shape[-3:-1]
        return Picture(
            depth.reshape(height, width), CameraIntrinsics(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        )

    opening = float(np.asarray(_at(obs, "extra", "opening")).reshape(-1)[0])
    force = obs["extra"].get("force")
    return Percept(qpos[0, :6], opening, take, None if force is None else float(np.asarray(force).reshape(-1)[0]))


def _at(obs: Mapping[str, Any], *keys: str) -> Any:
    value: Any = obs
    for depth, key in enumerate(keys):
        if not isinstance(value, Mapping) or key not in value:
            raise ObservationError(f"obs has no {'/'.join(keys[: depth + 1])}: use an obs_mode with depth")
        value = value[key]
    return value


@dataclass
class SeenObject:
    """An object on the table. points: (M, 3) m, base frame. evidence: for each view the probability of each class."""

    points: np.ndarray
    touches_border: bool
    evidence: list[dict[str, float]] = field(default_factory=list)

    @property
    def centroid(self) -> np.ndarray:
        return self.points.mean(axis=0)

    def probabilities(self) -> dict[str, float]:
        """The views' probabilities, multiplied and normalised: each view is one more independent look."""
        names = sorted({name for view in self.evidence for name in view})
        logs = np.array([sum(np.log(max(view.get(name, 0.0), 1e-3)) for view in self.evidence) for name in names])
        weights = np.exp(logs - logs.max())
        return dict(zip(names, (weights / weights.sum()).tolist(), strict=True))


@dataclass(frozen=True)
class View:
    """What one picture shows, base frame.

    objects: not yet classified. clouds: their points (M, 3) float32 in the camera frame, which classifiers take.
    plane: the table (4,) as n · p + d = 0, or None. obstacles: (K, 3) of what is no object but could be hit.
    """

    objects: list[SeenObject]
    clouds: list[np.ndarray]
    plane: np.ndarray | None
    obstacles: np.ndarray


def gripper_mask(points_camera: np.ndarray, opening: float) -> np.ndarray:
    """(…,) bool: points (…, 3) of the camera frame that may lie on the gripper itself."""
    T_gripper_camera = np.linalg.inv(T_TOOL0_GRIPPER) @ T_TOOL0_CAMERA
    R, t = T_gripper_camera[:3, :3], T_gripper_camera[:3, 3]
    hand = ROBOTIQ_2F_140
    tip = hand.pad_depth(opening) + hand.pad_length / 2 + _GRIPPER_MARGIN_M
    half_hinge = max(hand.finger_width / 2, 0.04) + _GRIPPER_MARGIN_M  # the palm is a can of 40 mm radius
    half_closing = max(opening / 2 + 0.03, 0.06) + _GRIPPER_MARGIN_M
    low, high = np.array([-half_hinge, -half_closing, 0.0]), np.array([half_hinge, half_closing, tip])
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True)), axis=-1).reshape(-1, 3)
    depths = ((corners - t) @ R)[:, 2]
    # Most of a picture lies behind the whole gripper: its depth alone says so.
    mask = (points_camera[..., 2] > depths.min() - 1e-6) & (points_camera[..., 2] < depths.max() + 1e-6)
    p = points_camera[mask] @ R.T + t
    mask[mask] = ((p > low) & (p < high)).all(axis=-1)
    return mask


def cut_out(percept: Percept, segmenter: Segmenter) -> Scene:
    """The objects in one picture, camera frame; `indices` are those of the picture's pixels, row by row."""
    cloud = deproject(*percept.picture)
    if percept.shows_gripper:
        cloud[gripper_mask(cloud, percept.opening)] = np.nan
    return segmenter.segment(cloud, up=percept.T_base_camera[:3, :3].T @ UP)


def look(percept: Percept, segmenter: Segmenter) -> View:
    """The objects in one picture."""
    scene = cut_out(percept, segmenter)
    T = percept.T_base_camera
    objects = [
        SeenObject(_moved(T, points), bool(border))
        for points, border in zip(scene.objects, scene.touches_border, strict=True)
    ]
    plane = None
    if scene.plane is not None:
        normal = T[:3, :3] @ scene.plane[:3]
        plane = np.append(normal, scene.plane[3] - normal @ T[:3, 3])
    obstacles = np.concatenate([np.zeros((0, 3)), *(_moved(T, points) for points in scene.obstacles)])
    return View(objects, list(scene.objects), plane, obstacles)


def _moved(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.asarray(points, float) @ T[:3, :3].T + T[:3, 3]


def class_probabilities(classifier: Any, clouds: Sequence[np.ndarray]) -> list[dict[str, float]]:
    """What a classifier says of clouds (M, 3), camera frame: class → probability; nothing of those with few points.

    ``classifier`` is a `pec.Classifier`, which takes all of them at once, or any callable cloud → (label, confidence).
    """
    least = getattr(classifier, "n_points", 1)
    known = [k for k, cloud in enumerate(clouds) if len(cloud) >= least]
    result: list[dict[str, float]] = [{} for _ in clouds]
    if known and hasattr(classifier, "predict"):
        answers = classifier.predict([clouds[k] for k in known])
        for k, answer in zip(known, answers, strict=True):
            result[k] = {name: float(p) for name, p in answer.probabilities.items()}
    else:
        for k in known:
            label, confidence = classifier(clouds[k])
            result[k] = {label: float(confidence), OTHER: 1.0 - float(confidence)}
    return result


def still_there(seen: SeenObject, percept: Percept, plane: np.ndarray | None) -> bool:
    """Whether an object stands where it was seen before: most of its place, as far as it is in sight now, is covered
    by something no higher than it.
    """
    normal, offset = (UP, 0.0) if plane is None else (plane[:3], plane[3])
    cloud = deproject(*percept.picture)
    T = percept.T_base_camera
    valid = np.isfinite(cloud[..., 2])
    if percept.shows_gripper:
        valid &= ~gripper_mask(cloud, percept.opening)
    now = _moved(T, cloud[valid])
    height = now @ normal + offset
    top = float((seen.points @ normal + offset).max())
    in_sight = height < top + _PLACE_CELL_M

    def cells(points: np.ndarray) -> np.ndarray:
        return np.unique(np.floor(points[:, :2] / _PLACE_CELL_M).astype(np.int64) @ [1_000_003, 1])

    place = cells(seen.points)
    visible = np.isin(place, cells(now[in_sight]))
    covered = np.isin(place, cells(now[in_sight & (height > _ABOVE_TABLE_M)]))
    return bool(visible.sum() > 0.3 * len(place) and covered.sum() > 0.6 * visible.sum())


def merge(known: list[SeenObject], seen: list[SeenObject]) -> list[SeenObject]:
    """Objects of a new view joined with those already known: the same place is the same object; its points add up."""
    result = list(known)
    for new in seen:
        near = [old for old in known if np.linalg.norm((old.centroid - new.centroid)[:2]) < _SAME_OBJECT_M]
        if not near:
            result.append(new)
            continue
        old = min(near, key=lambda candidate: float(np.linalg.norm((candidate.centroid - new.centroid)[:2])))
        old.points = np.concatenate([old.points, new.points])
        old.touches_border = old.touches_border and new.touches_border
        old.evidence += new.evidence
    return result


_OPENING_SLACK_M = 0.002  # a measured opening may lie a little outside of the stroke


def percept_of(
    depth: ArrayLike,
    intrinsics: CameraIntrinsics,
    T_base_camera: ArrayLike,
    q: ArrayLike | None,
    opening: float | None,
) -> Percept:
    """One picture of a camera anywhere, checked, as the policy reads it.

    Raises ObservationError that names what is wrong.
    """
    depth = np.nan_to_num(np.asarray(depth, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    expected = (intrinsics.height, intrinsics.width)
    if depth.shape != expected:
        raise ObservationError(f"depth has shape {depth.shape}; the intrinsics are of a picture {expected}")
    T = np.asarray(T_base_camera, float)
    if T.shape != (4, 4) or not np.isfinite(T).all() or np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > 1e-3:
        raise ObservationError(f"T_base_camera must be a rigid transform (4, 4), got {T.tolist()}")
    joints = np.zeros(6) if q is None else np.asarray(q, float)
    if joints.shape != (6,) or not np.isfinite(joints).all():
        raise ObservationError(f"q must be six joint angles in radians, got {joints.tolist()}")
    if opening is not None and not -_OPENING_SLACK_M <= opening <= ROBOTIQ_2F_140.stroke + _OPENING_SLACK_M:
        raise ObservationError(f"opening={opening}: must be within 0 … {ROBOTIQ_2F_140.stroke} m")
    taken, shown = Picture(depth, intrinsics), opening is not None
    return Percept(joints, opening or 0.0, lambda: taken, camera=T, shows_gripper=shown)
