"""Where on the table an object that is held can be put down, and how the arm gets it there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.motion.clearance import Clearance
from pecgrasp_env.motion.joint_path import MotionError, solutions_near, straight_line
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.kinematics import T_TOOL0_GRIPPER, UP, forward_kinematics

_CELL_M = 0.01
_LEVEL_M = 0.008  # table, within the sensor's noise
_LEAST_POINTS = 3  # of a cell, less are stray ones
_BESIDE_M = 0.02  # between the object and all else
_RELEASE_M = 0.04  # of opening more than that with which the object is held
_DROP_M = 0.004
_REACH_M = (0.28, 0.72)  # of the hand, from the robot's base
_PLACES = 12
_APART_M = 0.06  # between two places that are tried


@dataclass(frozen=True)
class PutDown:
    """Joint paths: over the place (K, 6), and straight down to it (M, 6); opening [m] that lets go of the object."""

    over: np.ndarray
    down: np.ndarray
    opening: float


def plan_put_down(
    held: np.ndarray,
    q_closed: np.ndarray,
    q_now: np.ndarray,
    opening: float,
    seen: np.ndarray,
    plane: np.ndarray,
    arm: ArmLengths = UR5,
) -> PutDown:
    """The nearest free place on the table, and the way there.

    Args:
        held: (M, 3) of the object, where it was taken hold of, base frame, m.
        q_closed, q_now: (6,) rad, when the hand had closed there, and now, lifted.
        opening: with which it is held, m.
        seen: (K, 3) of everything that was seen, the table, too, and the held object where it lay.
        plane: the table (4,).
        arm: which one it is.

    Raises:
        MotionError: there is no free place in reach.
    """
    T_closed, T_now = forward_kinematics(q_closed, arm), forward_kinematics(q_now, arm)
    middle = (held[:, :2].min(axis=0) + held[:, :2].max(axis=0)) / 2
    wide = min(opening + _RELEASE_M, ROBOTIQ_2F_140.stroke)
    footprint = np.concatenate([held[:, :2], _tips(T_closed, wide)[:, :2]]) - middle
    height = seen @ plane[:3] + plane[3]
    # Down until the lowest that was seen of the object, or a fingertip, is just above the table.
    lowest = float(np.quantile(held @ plane[:3] + plane[3], 0.02))
    descent = min(lowest, float((_tips(T_closed, opening) @ plane[:3]).min() + plane[3])) - _DROP_M
    others = seen[height > _LEVEL_M]
    clearance = Clearance(np.zeros((0, 3)), others, plane, arm)
    problem: MotionError | None = None
    for place in _nearest(free_places(seen, height, footprint), T_now[:2, 3], T_closed[:2, 3] - middle, arm.share):
        T_down = T_closed.copy()
        T_down[:3, 3] += np.append(place - middle, 0.0) - descent * UP
        T_over = T_down.copy()
        T_over[2, 3] = T_now[2, 3]
        for q_over in list(solutions_near(T_over, q_now, arm))[:2]:
            try:
                down = straight_line(q_over, T_over, T_down, arm)
                trouble = clearance.trouble_at_object(down, wide, tight=False)
                if trouble is not None:
                    raise MotionError(trouble)
                return PutDown(clearance.free_path(q_now, q_over), down, wide)
            except MotionError as error:
                problem = problem or error
    raise problem or MotionError("no free place on the table was seen")


def free_places(seen: np.ndarray, height: np.ndarray, footprint: np.ndarray) -> np.ndarray:
    """Places (P, 2) on the table for the middle of a footprint (F, 2), m from it: under all of that, and 2 cm around,
    the table was seen, and nothing stands there.

    seen: (K, 3); height: (K,) above the table, m.
    """
    near = (np.abs(height) <= _LEVEL_M) | (height > 0)
    cells = np.floor(seen[near, :2] / _CELL_M).astype(int)
    corner = cells.min(axis=0, initial=0)
    index, shape = tuple((cells - corner + 1).T), cells.max(axis=0, initial=0) - corner + 3
    counts = {}
    for name, which in (("table", np.abs(height[near]) <= _LEVEL_M), ("thing", height[near] > _LEVEL_M)):
        counts[name] = np.zeros(shape, int)
        np.add.at(counts[name], tuple(each[which] for each in index), 1)
    free = (counts["table"] >= _LEAST_POINTS) & (counts["thing"] < _LEAST_POINTS)
    room = ndimage.distance_transform_edt(free) * _CELL_M
    places = np.argwhere(room >= _BESIDE_M)
    for offset in np.unique(np.round(footprint / _CELL_M).astype(int), axis=0):
        there = places + offset
        inside = ((there >= 0) & (there < shape)).all(axis=1)
        places, there = places[inside], there[inside]
        places = places[room[there[:, 0], there[:, 1]] >= _BESIDE_M]
    return (places + corner - 0.5) * _CELL_M


def _nearest(places: np.ndarray, to: np.ndarray, hand: np.ndarray, share: float) -> Iterator[np.ndarray]:
    """Those within the arm's reach, the nearest first and no two near each other; hand: (2,) from place to hand.
    share: of the UR5's reach.
    """
    distance = np.linalg.norm(places + hand, axis=1)
    places = places[(distance >= share * _REACH_M[0]) & (distance <= share * _REACH_M[1])]
    given: list[np.ndarray] = []
    for place in places[np.argsort(np.linalg.norm(places + hand - to, axis=1), kind="stable")]:
        if len(given) < _PLACES and all(np.linalg.norm(place - other) >= _APART_M for other in given):
            given.append(place)
            yield place


def _tips(T_base_tool0: np.ndarray, opening: float) -> np.ndarray:
    """Outer corners (4, 3) of the fingertips, base frame, at an opening (m)."""
    hand = ROBOTIQ_2F_140
    x, y = hand.finger_width / 2, opening / 2 + hand.finger_thickness
    z = float(hand.pad_depth(opening)) + hand.pad_length / 2
    tips = np.array([[sx * x, sy * y, z, 1.0] for sx in (-1, 1) for sy in (-1, 1)])
    return np.asarray((T_base_tool0 @ T_TOOL0_GRIPPER @ tips.T)[:3].T)
