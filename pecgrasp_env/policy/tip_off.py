"""How an object is lifted that others lie on: tipped while it is still low, so that they slide off and stay behind."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pecgrasp_env.motion.clearance import Clearance
from pecgrasp_env.motion.grasp_approach import Approach
from pecgrasp_env.motion.joint_path import MotionError, straight_line
from pecgrasp_env.robot.kinematics import UP, forward_kinematics

_TIP_RAD = np.deg2rad(40)  # what is as rough as cardboard or plastic slides from 30° on
_STEP_RAD = np.deg2rad(10)  # in which the pads leave their arc by less than 1 mm
_TURNS_RAD = np.deg2rad([0, 40, -40, 80, -80])  # from the side on which they lie
_CLEAR_M = 0.005  # of its lower end, more than where it lay
_FARTHEST_M = 0.10  # of that end from the pads: what is longer is held near its middle


@dataclass(frozen=True)
class TippedLift:
    """Joint waypoints: tip (K, 6) raises the object by one end while its other end stays where it was; up (M, 6) goes
    on from there, turning it back.
    """

    tip: np.ndarray
    up: np.ndarray


def plan_tipped_lift(
    q_closed: np.ndarray,
    approach: Approach,
    held: np.ndarray,
    upon: np.ndarray,
    others: np.ndarray,
    plane: np.ndarray | None,
) -> TippedLift:
    """How to lift an object (M, 3) that other things (N, 3) lie on: tipped to their side, or as near to it as the hand
    has room.

    Args:
        q_closed: (6,) rad, the hand closed on it.
        approach: that led there.
        held, upon: points in the base frame, m.
        others: (K, 3) of all else that was seen, what lies on it included.
        plane: the table (4,), or None for z = 0.

    Raises:
        MotionError: the hand has no room to tip it.
    """
    arm, pads = approach.arm, approach.T_base_grasp[:3, 3]
    ground = np.append(UP, 0.0) if plane is None else plane
    clearance = Clearance(np.zeros((0, 3)), others, ground, arm)
    T_closed, T_end = forward_kinematics(q_closed, arm), forward_kinematics(approach.to_lift[-1], arm)
    problem: MotionError | None = None
    for side in _sides((upon.mean(axis=0) - pads)[:2]):
        reach = min(max(float(np.quantile((held - pads)[:, :2] @ side, 0.98)), 0.0), _FARTHEST_M)
        path, T = [np.asarray(q_closed, float)[None]], T_closed
        try:
            for angle in np.arange(_STEP_RAD, _TIP_RAD + _STEP_RAD / 2, _STEP_RAD):
                T_next = tipped(T_closed, pads, side, angle, reach)
                path.append(straight_line(path[-1][-1], T, T_next, arm)[1:])
                T = T_next
            tip = np.concatenate(path)
            trouble = clearance.trouble_at_object(tip, approach.grasp.width, tight=True)
            if trouble is not None:
                raise MotionError(trouble)
            return TippedLift(tip, straight_line(tip[-1], T, T_end, arm))
        except MotionError as error:
            problem = problem or error
    raise problem or MotionError("no side to tip it to")


def tipped(T_base_tool0: np.ndarray, pads: np.ndarray, side: np.ndarray, angle: float, reach: float) -> np.ndarray:
    """The flange's pose (4, 4) with the object turned by an angle, rad, about the pads (3,), its end on a side, (2,) of
    length 1, down, and raised so far that this end, ``reach`` (m) from the pads, does not sink.
    """
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec(angle * np.cross(UP, np.append(side, 0.0))).as_matrix()
    turn[:3, 3] = pads - turn[:3, :3] @ pads + (reach * np.sin(angle) + _CLEAR_M) * UP
    return np.asarray(turn @ T_base_tool0)


def _sides(towards: np.ndarray) -> Iterator[np.ndarray]:
    heading = np.arctan2(towards[1], towards[0])
    for turned in _TURNS_RAD:
        yield np.array([np.cos(heading + turned), np.sin(heading + turned)])
