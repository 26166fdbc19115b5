"""One observation as a real robot has it: joint angles, gripper, and the depth frame of the camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from grasping import ROBOTIQ_2F_140, CloudError
from grasping.cloud_files.depth_frame import checked_intrinsics
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.collision_spheres import TOOL, body, robot_spheres
from pecgrasp_env.robot.kinematics import HOME, T_TOOL0_CAMERA, forward_kinematics
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

_FARTHEST_M = 20.0  # half of a frame is never as far from a table
_OPENING_SLACK_M = 0.002  # a measured opening may lie a little outside of the stroke


class ObservationError(ValueError):
    """The observation lacks what the policy needs; the message names the key."""


class DepthFrame(NamedTuple):
    """depth: (H, W) float32 m along the optical axis, 0 for none."""

    depth: np.ndarray
    intrinsics: CameraIntrinsics


@dataclass(frozen=True)
class RobotObservation:
    """One moment: joint angles (6,) rad, gripper opening m, the camera's depth frame, and the force between the pads,
    N, where the gripper measures it.

    take: takes the frame when it is first used. camera: T_base_camera (4, 4) where it is known otherwise than from the
    joint angles. knows_arm, knows_gripper: whether the joint angles and the opening are the robot's, so that it can be
    told apart where it stands in the frame. arm: whose joint angles these are.
    """

    q: np.ndarray
    opening: float
    take: Callable[[], DepthFrame]
    force: float | None = None
    camera: np.ndarray | None = None
    knows_arm: bool = True
    knows_gripper: bool = True
    arm: ArmLengths = UR5

    @cached_property
    def frame(self) -> DepthFrame:
        """Taken once."""
        return self.take()

    @property
    def T_base_camera(self) -> np.ndarray:
        """From the joint angles and the bracket's calibration, as on a real robot, unless it is given."""
        return forward_kinematics(self.q, self.arm) @ T_TOOL0_CAMERA if self.camera is None else self.camera

    @property
    def T_tool0_camera(self) -> np.ndarray:
        """How the camera stands to the hand now, wherever it is mounted; the bracket's, where the arm is not known."""
        if self.camera is None or not self.knows_arm:
            return T_TOOL0_CAMERA
        return np.linalg.inv(forward_kinematics(self.q, self.arm)) @ self.camera

    @property
    def robot(self) -> np.ndarray:
        """(K, 4) x, y, z and radius, m, camera frame: spheres that cover what is known of the robot.

        All of it; without the opening its arm; without the joint angles the hand, of a camera on the bracket.
        """
        parts = body(self.opening, self.arm)
        if self.knows_arm:
            return robot_spheres(self.q, self.opening, self.T_base_camera, self.arm)[
                self.knows_gripper | ~parts.gripper
            ]
        on_bracket = robot_spheres(HOME, self.opening, forward_kinematics(HOME) @ T_TOOL0_CAMERA)
        return on_bracket[self.knows_gripper & (parts.frame == TOOL)]


def read_observation(obs: Mapping[str, Any]) -> RobotObservation:
    """A visual observation of SelectiveGrasp-v1 with depth, batched with one sub-environment or not batched.

    Raises:
        ObservationError: a key is missing, or there is more than one sub-environment.
    """
    take = camera_frame(obs, "wrist_camera")
    qpos = np.atleast_2d(np.asarray(at(obs, "agent", "qpos"), float))
    if len(qpos) != 1:
        raise ObservationError(f"obs holds {len(qpos)} sub-environments: the policy drives one robot")
    opening = float(np.asarray(at(obs, "extra", "opening")).reshape(-1)[0])
    force = obs["extra"].get("force")
    measured = None if force is None else float(np.asarray(force).reshape(-1)[0])
    return RobotObservation(qpos[0, :6], opening, take, measured)


def camera_frame(obs: Mapping[str, Any], camera: str) -> Callable[[], DepthFrame]:
    """Takes the depth frame of a camera out of a visual observation, when it is first asked for.

    Raises ObservationError where there is none.
    """
    images = at(obs, "sensor_data", camera)
    if "depth" not in images:
        raise ObservationError(f"obs has no sensor_data/{camera}/depth: use an obs_mode with depth")
    K = np.asarray(at(obs, "sensor_param", camera, "intrinsic_cv"), float).reshape(3, 3)

    def take() -> DepthFrame:
        depth = np.asarray(images["depth"], np.float32)
        height, width = depth.shape[-3:-1]
        return DepthFrame(
            depth.reshape(height, width), CameraIntrinsics(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        )

    return take


def at(obs: Mapping[str, Any], *keys: str) -> Any:
    """What lies under these keys, one in the other. Raises ObservationError that says where the way ends."""
    value: Any = obs
    for depth, key in enumerate(keys):
        if not isinstance(value, Mapping) or key not in value:
            raise ObservationError(f"obs has no {'/'.join(keys[: depth + 1])}: use an obs_mode with depth")
        value = value[key]
    return value


def observation_of_frame(
    depth: ArrayLike,
    intrinsics: CameraIntrinsics,
    T_base_camera: ArrayLike,
    q: ArrayLike | None,
    opening: float | None,
    arm: ArmLengths = UR5,
) -> RobotObservation:
    """The observation of one depth frame, of a camera anywhere, checked.

    Raises ObservationError that names what is wrong.
    """
    if not isinstance(intrinsics, CameraIntrinsics):
        raise ObservationError(
            f"intrinsics must be CameraIntrinsics(width, height, fx, fy, cx, cy), got {intrinsics!r}"
        )
    depth = np.nan_to_num(np.asarray(depth, np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    expected = (intrinsics.height, intrinsics.width)
    if depth.shape != expected:
        raise ObservationError(f"depth has shape {depth.shape}; the intrinsics are of a frame {expected}")
    try:
        checked_intrinsics(intrinsics.matrix, depth.shape, "intrinsics")
    except CloudError as error:
        raise ObservationError(str(error)) from error
    if (depth > 0).any() and (middle := float(np.median(depth[depth > 0]))) > _FARTHEST_M:
        raise ObservationError(f"depth: half of it is beyond {middle:.4g} m; give metres, not millimetres")
    T = np.asarray(T_base_camera, float)
    if T.shape != (4, 4) or not np.isfinite(T).all() or np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() > 1e-3:
        raise ObservationError(f"T_base_camera must be a rigid transform (4, 4), got {T.tolist()}")
    joints = np.zeros(6) if q is None else np.asarray(q, float)
    if joints.shape != (6,) or not np.isfinite(joints).all():
        raise ObservationError(f"q must be six joint angles in radians, got {joints.tolist()}")
    if opening is not None and not -_OPENING_SLACK_M <= opening <= ROBOTIQ_2F_140.stroke + _OPENING_SLACK_M:
        raise ObservationError(f"opening={opening}: must be within 0 … {ROBOTIQ_2F_140.stroke} m")
    taken = DepthFrame(depth, intrinsics)
    known = {"knows_arm": q is not None, "knows_gripper": opening is not None}
    return RobotObservation(joints, opening or 0.0, lambda: taken, camera=T, arm=arm, **known)
