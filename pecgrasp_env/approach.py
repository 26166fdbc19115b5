"""From a grasp on a cloud to joint paths: over the object, straight down to it, and straight up again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasping import ROBOTIQ_2F_140, Grasp, GraspPlan
from pecgrasp_env.motion import MotionError, joint_move, lowest_link, lowest_tip, solutions_near, straight_line
from pecgrasp_env.robot import tool0_from_grasp
from pecgrasp_env.views import HOME

LIFT_M = 0.25  # an object held at one end hangs down
_OPEN_MARGIN_M = 0.03  # wider than the object, both sides together, where the planner has no wish of its own
_TIP_CLEARANCE_M = 0.004  # between fingertips and table
_FINGER_THICKNESS_M = 0.015
_OVERCLOSE_M = 0.01  # closing further than planned pushes the tips forward
_STANDOFF_M = 0.08
_OVER_OBJECTS_M = 0.03
_LOWEST_LINK_M = 0.06
_FREE_M = 0.05  # lifted so far, an object is clear of the table's friction and of low neighbours
_CARRY_RADIUS_M = 0.60
_TRIED_GRASPS = 24


@dataclass(frozen=True)
class Approach:
    """Joint paths (K, 6) to a grasp, and the opening [m] to go there with."""

    grasp: Grasp
    opening: float
    to_pregrasp: np.ndarray
    to_grasp: np.ndarray
    to_lift: np.ndarray


def plan_approach(
    plan: GraspPlan, points: np.ndarray, obstacles: np.ndarray, plane: np.ndarray | None, q_now: np.ndarray
) -> Approach:
    """The best grasp of the plan that the arm can carry out, with its paths.

    Args:
        plan: grasps in the base frame, at least one.
        points: (M, 3) of the object. obstacles: (K, 3) of the others.
        plane: the table (4,), or None for z = 0.
        q_now: (6,) where the arm is.

    Raises:
        MotionError: the arm can carry out none of them; the message is that of the best.
    """
    plane = np.array([0.0, 0.0, 1.0, 0.0]) if plane is None else plane
    heights = np.concatenate([points, obstacles]) @ plane[:3] + plane[3]
    travel_height = float(heights.max()) + _OVER_OBJECTS_M
    problem: MotionError | None = None
    for grasp in plan.candidates[:_TRIED_GRASPS]:
        found = []
        for T in (np.asarray(grasp.pose), grasp.pose @ np.diag([-1.0, -1.0, 1.0, 1.0])):
            try:
                found.append(_try(grasp, clear_of_table(T, grasp.width, plane), travel_height, q_now))
            except MotionError as error:
                problem = problem or error
        if found:
            return min(found, key=_length)
    raise problem or MotionError("no grasp to go to")


def clear_of_table(T_base_grasp: np.ndarray, width: float, plane: np.ndarray) -> np.ndarray:
    """The grasp pose, drawn back along its approach as far as the fingertips need to stay off the table, (4, 4)."""
    hand = ROBOTIQ_2F_140
    forward = hand.pad_length / 2 + hand.pad_depth(max(width - _OVERCLOSE_M, 0.0)) - hand.pad_depth(width)
    x, y = width / 2 + _FINGER_THICKNESS_M, hand.finger_width / 2
    tips = np.array([[sx * x, sy * y, forward, 1.0] for sx in (-1, 1) for sy in (-1, 1)]) @ T_base_grasp.T
    lowest = float((tips[:, :3] @ plane[:3]).min() + plane[3])
    descent = -float(T_base_grasp[:3, 2] @ plane[:3])
    result = T_base_grasp.copy()
    if lowest < _TIP_CLEARANCE_M and descent > 0.1:
        result[:3, 3] -= (_TIP_CLEARANCE_M - lowest) / descent * T_base_grasp[:3, 2]
    return result


def _try(grasp: Grasp, T_base_grasp: np.ndarray, travel_height: float, q_now: np.ndarray) -> Approach:
    hand = ROBOTIQ_2F_140
    width = min(max(grasp.width, 0.0), hand.stroke)
    T_grasp = tool0_from_grasp(T_base_grasp, width)
    # Far enough back that the fingertips pass over everything on the way there.
    tip = T_base_grasp[2, 3] + T_base_grasp[2, 2] * hand.pad_length / 2
    descent = max(-T_base_grasp[2, 2], 0.3)
    standoff = max(_STANDOFF_M, (travel_height - tip) / descent)
    T_pregrasp = T_grasp.copy()
    T_pregrasp[:3, 3] -= standoff * T_grasp[:3, 2]
    problem = MotionError(f"the pre-grasp at {np.round(T_pregrasp[:3, 3], 3)} m is out of reach")
    for q_pregrasp in solutions_near(T_pregrasp, HOME, q_now):
        try:
            down = straight_line(q_pregrasp, T_pregrasp, T_grasp)
            up = _lift(down[-1], T_grasp)
        except MotionError as error:
            problem = error
            continue
        there = joint_move(q_now, q_pregrasp)
        if min(lowest_link(path) for path in (there, down, up)) < _LOWEST_LINK_M:
            problem = MotionError("a link would come too near the table")
        elif lowest_tip(there) < min(travel_height, tip + standoff) - 0.01:
            problem = MotionError("the fingertips would come too low on the way there")
        else:
            opening = min(hand.stroke, grasp.terms.get("opening", width + _OPEN_MARGIN_M))
            return Approach(grasp, opening, there, down, up)
    raise problem


def _lift(q_grasp: np.ndarray, T_grasp: np.ndarray) -> np.ndarray:
    """Straight up; near the end of the arm's reach, where that fails, up a little and then up and inwards."""
    T_up = T_grasp.copy()
    T_up[2, 3] += LIFT_M
    try:
        return straight_line(q_grasp, T_grasp, T_up)
    except MotionError:
        T_off = T_grasp.copy()
        T_off[2, 3] += _FREE_M
        off = straight_line(q_grasp, T_grasp, T_off)
        T_up[:2, 3] *= min(1.0, _CARRY_RADIUS_M / float(np.hypot(*T_up[:2, 3])))
        return np.concatenate([off, straight_line(off[-1], T_off, T_up)[1:]])


def _length(approach: Approach) -> float:
    return float(np.abs(approach.to_pregrasp[-1] - approach.to_pregrasp[0]).max())
