"""What `ScriptedPolicy.plan_only` answers: where the hand must go, for people who move an arm themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from grasping import ROBOTIQ_2F_140, GraspPlan
from pecgrasp_env.approach import Approach, grasp_to_carry_out, plan_approach
from pecgrasp_env.motion import MotionError
from pecgrasp_env.perception import ObservationError, Percept, Picture, SeenObject
from pecgrasp_env.sensor import CameraIntrinsics

_OPENING_SLACK_M = 0.002  # a measured opening may lie a little outside of the stroke


@dataclass(frozen=True)
class PlannedPick:
    """One picture's answer. All poses in the robot's base frame, metres, (4, 4) float64.

    objects: what was seen, with what each was taken for. chosen: index of the asked-for one, or None. plan: its grasps.
    approach: joint paths of a UR5 with this project's gripper, where its joint angles were given. confidence: that the
    chosen object is of the asked-for class. reason: why there is no grasp or no path, or None.
    T_base_grasp: pads' centre, z the approach, x the closing direction, the fingertips clear of the table.
    T_base_tool0: the flange there. width, opening: m, at contact and to come in with. They are None where there is no
    grasp.
    """

    objects: list[SeenObject]
    chosen: int | None
    plan: GraspPlan | None
    approach: Approach | None
    confidence: float
    reason: str | None
    T_base_grasp: np.ndarray | None = None
    T_base_tool0: np.ndarray | None = None
    width: float | None = None
    opening: float | None = None

    def completed(self, q: np.ndarray | None, around: np.ndarray, plane: np.ndarray | None) -> PlannedPick:
        """With the pose of the best grasp; from joint angles q (6,) also with the paths, to the best that has some."""
        if self.plan is None or self.plan.best is None or self.chosen is None:
            why = "" if self.plan is None else self.plan.reason
            return replace(self, reason=f"no grasp: {why}")
        approach = None
        if q is None:
            grasp = self.plan.best
            T_base_grasp, T_base_tool0, opening = grasp_to_carry_out(grasp, plane)
        else:
            try:
                approach = plan_approach(self.plan, self.objects[self.chosen].points, around, plane, q)
            except MotionError as error:
                return replace(self, reason=f"no motion: {error}")
            grasp, T_base_grasp, T_base_tool0 = approach.grasp, approach.T_base_grasp, approach.T_base_tool0
            opening = approach.opening
        found = replace(self, approach=approach, width=grasp.width, opening=opening)
        return replace(found, T_base_grasp=T_base_grasp, T_base_tool0=T_base_tool0)


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
