"""From a grasp on a cloud to joint paths: over the object, down to it, back while it closes, straight up again.

Parallelogram fingers push the pads forward while they close, by up to 29 mm over the stroke. The hand comes down with
the tips where they are to hold, at the opening that it comes in with, and is drawn back along its approach by what the
pads advance: so the tips stay at one height, whatever the width at which they meet the object.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasping import ROBOTIQ_2F_140, Grasp, GraspPlan
from pecgrasp_env.motion.clearance import Clearance
from pecgrasp_env.motion.joint_path import LARGEST_JOINT_STEP, LINE_STEP_M, MotionError, unwound, within_limits, wrapped
from pecgrasp_env.robot import tool0_from_grasp
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.batch_kinematics import BRANCHES, inverse_kinematics_batch, nearest_turns
from pecgrasp_env.robot.kinematics import UP, home

LIFT_M = 0.25  # an object held at one end hangs down
_OPEN_MARGIN_M = 0.03  # wider than the object, both sides together, where the planner has no wish of its own
_TIP_CLEARANCE_M = 0.001  # between fingertips and table: the measured table is off by 0.1 mm, the arm by less than 1 mm
_STANDOFF_M = 0.08
_OVER_OBJECTS_M = 0.03
_FREE_M = 0.06  # lifted so far, an object is clear of the table's friction and of low neighbours
_CARRY_RADIUS_M = 0.60
_TRIED_GRASPS = 24
_CLOSING_STEPS = 8  # postures on the way to the closed hand; joints that turn evenly in between are off by under 0.2 mm
_AT_ONCE = 2  # grasps whose paths are computed together: mostly one of the first can be carried out
_TRIED_PATHS = 4  # for one grasp


@dataclass(frozen=True)
class Approach:
    """Joint paths (K, 6) to a grasp and up again, and the opening [m] to go there with.

    T_base_grasp: (4, 4) as it is carried out, the fingertips clear of the table, the closing direction turned round
    where that suits the arm. T_base_tool0: (4, 4) of the flange there, at contact. to_grasp ends, and to_close (M, 6)
    starts, with the pads there at `opening`; to_close keeps them there at M openings that fall evenly to 0. to_lift
    goes up from the last of those. arm: whose joints they are.
    """

    grasp: Grasp
    opening: float
    T_base_grasp: np.ndarray
    T_base_tool0: np.ndarray
    to_pregrasp: np.ndarray
    to_grasp: np.ndarray
    to_close: np.ndarray
    to_lift: np.ndarray
    arm: ArmLengths = UR5

    def posture_at(self, opening: float) -> np.ndarray:
        """The joint angles (6,) that have the pads where they are to hold, the fingers at an opening (m)."""
        openings = np.linspace(0.0, self.opening, len(self.to_close))
        return np.array([np.interp(opening, openings, joint) for joint in self.to_close[::-1].T])


@dataclass(frozen=True)
class _Candidate:
    """A grasp in one of its two closing directions: T_base_tool0 at contact, standoff [m] of the pre-grasp before it.

    advance: (M,) how far [m] the flange is in front of T_base_tool0 at M openings from that to come in with to 0.
    """

    grasp: Grasp
    T_base_grasp: np.ndarray
    T_base_tool0: np.ndarray
    advance: np.ndarray
    standoff: float


def plan_approach(
    plan: GraspPlan,
    points: np.ndarray,
    obstacles: np.ndarray,
    plane: np.ndarray | None,
    q_now: np.ndarray,
    arm: ArmLengths = UR5,
    robot: np.ndarray | None = None,
) -> Approach:
    """The best grasp of the plan that the arm can carry out, with its paths, free of all that was seen.

    Args:
        plan: grasps in the base frame, at least one.
        points: (M, 3) of the object. obstacles: (K, 3) of the others.
        plane: the table (4,), or None for z = 0.
        q_now: (6,) where the arm is.
        arm: which one it is.
        robot: (S, 4) spheres of another robot, which stands still, base frame.

    Raises:
        MotionError: the arm can carry out none of them; the message is that of the best.
    """
    plane = np.array([0.0, 0.0, 1.0, 0.0]) if plane is None else plane
    clearance = Clearance(points, obstacles, plane, arm, robot)
    problem: MotionError | None = None
    # From above everything where the arm reaches that; else from just over the object; at last with less room beside.
    for over_all, tight in ((True, False), (False, False), (False, True)):
        height = clearance.top + _OVER_OBJECTS_M if over_all else 0.0
        for first in range(0, min(len(plan.candidates), _TRIED_GRASPS), _AT_ONCE):
            grasps = plan.candidates[first : min(first + _AT_ONCE, _TRIED_GRASPS)]
            candidates = [candidate for grasp in grasps for candidate in _both_directions(grasp, plane, height)]
            paths, down = _paths(candidates, arm)
            paths = unwound(nearest_turns(paths, q_now, arm))
            for k in range(0, len(candidates), 2):
                try:
                    return _first_free(candidates[k : k + 2], paths[k : k + 2], down, clearance, tight, q_now, arm)
                except MotionError as error:
                    problem = problem or error
    raise problem or MotionError("no grasp to go to")


def grasp_to_carry_out(grasp: Grasp, plane: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, float]:
    """T_base_grasp (4, 4) with the fingertips clear of the table, T_base_tool0 (4, 4) there, and the opening [m] to
    come in with; plane (4,): the table, or None for z = 0.
    """
    candidate = _both_directions(grasp, np.array([0.0, 0.0, 1.0, 0.0]) if plane is None else plane, 0.0)[0]
    return candidate.T_base_grasp, candidate.T_base_tool0, _opening_of(grasp)


def _opening_of(grasp: Grasp) -> float:
    return float(min(ROBOTIQ_2F_140.stroke, grasp.terms.get("opening", grasp.width + _OPEN_MARGIN_M)))


def clear_of_table(T_base_grasp: np.ndarray, opening: float, plane: np.ndarray) -> np.ndarray:
    """The grasp pose, drawn back along its approach as far as the fingertips need to stay off the table, (4, 4).

    opening: the widest, m, at which the pads are at the pose: of a tilted hand one tip is then lowest.
    """
    hand = ROBOTIQ_2F_140
    x, y, z = opening / 2 + hand.finger_thickness, hand.finger_width / 2, hand.pad_length / 2
    tips = np.array([[sx * x, sy * y, z, 1.0] for sx in (-1, 1) for sy in (-1, 1)]) @ T_base_grasp.T
    lowest = float((tips[:, :3] @ plane[:3]).min() + plane[3])
    descent = -float(T_base_grasp[:3, 2] @ plane[:3])
    result = T_base_grasp.copy()
    if lowest < _TIP_CLEARANCE_M and descent > 0.1:
        result[:3, 3] -= (_TIP_CLEARANCE_M - lowest) / descent * T_base_grasp[:3, 2]
    return result


def _both_directions(grasp: Grasp, plane: np.ndarray, travel_height: float) -> list[_Candidate]:
    """The grasp and itself turned half round; the pre-grasp is so far back that the tips pass over `travel_height`."""
    hand = ROBOTIQ_2F_140
    opening, width = _opening_of(grasp), min(max(grasp.width, 0.0), hand.stroke)
    depth = np.array([hand.pad_depth(each) for each in np.linspace(opening, 0.0, _CLOSING_STEPS + 1)])
    result = []
    for T in (np.asarray(grasp.pose), grasp.pose @ np.diag([-1.0, -1.0, 1.0, 1.0])):
        T_grasp = clear_of_table(T, opening, plane)
        tip = T_grasp[:3, 3] @ plane[:3] + plane[3] + T_grasp[:3, 2] @ plane[:3] * hand.pad_length / 2
        descent = max(-float(T_grasp[:3, 2] @ plane[:3]), 0.3)
        standoff = max(_STANDOFF_M, (travel_height - float(tip)) / descent)
        advance = hand.pad_depth(width) - depth
        result.append(_Candidate(grasp, T_grasp, tool0_from_grasp(T_grasp, width), advance, standoff))
    return result


def _paths(candidates: list[_Candidate], arm: ArmLengths) -> tuple[np.ndarray, int]:
    """Postures (W, 8, K, 6) from the pre-grasp down, back and up again, of all branches, NaN out of reach; and how many
    of the K lead to the grasp; the next _CLOSING_STEPS go back.
    """
    down = 1 + int(np.ceil(max(candidate.standoff for candidate in candidates) / LINE_STEP_M))
    lift = LIFT_M * arm.share
    up = int(np.ceil(lift / LINE_STEP_M))
    at_grasp = np.array([candidate.T_base_tool0 for candidate in candidates])
    place, approach = at_grasp[:, :3, 3], at_grasp[:, :3, 2]
    # Straight up; where the arm does not reach that high, up a little and then up and inwards.
    off, top = place + _FREE_M * UP, place + lift * UP
    highest = at_grasp.copy()
    highest[:, :3, 3] = top
    far = np.isnan(inverse_kinematics_batch(highest, arm)).any(axis=2).all(axis=1)
    inwards = np.minimum(1.0, _CARRY_RADIUS_M * arm.share / np.hypot(top[:, 0], top[:, 1]))
    top[far, :2] *= inwards[far, None]
    advance = np.array([candidate.advance for candidate in candidates])
    standoff = np.array([candidate.standoff for candidate in candidates])
    forward = np.concatenate([advance[:, :1] - standoff[:, None] * np.linspace(1.0, 0.0, down), advance[:, 1:]], axis=1)
    closed = place + advance[:, -1:] * approach
    free = max(1, int(np.ceil(up * _FREE_M / lift)))
    rise = np.linspace(0.0, 1.0, free + 1)[1:, None]
    carry = np.linspace(0.0, 1.0, up - free + 1)[1:, None]
    positions = np.concatenate(
        [
            place[:, None] + forward[..., None] * approach[:, None],
            closed[:, None] + rise * (off - closed)[:, None],
            off[:, None] + carry * (top - off)[:, None],
        ],
        axis=1,
    )
    poses = np.repeat(at_grasp[:, None], positions.shape[1], axis=1)
    poses[..., :3, 3] = positions
    branches = inverse_kinematics_batch(poses.reshape(-1, 4, 4), arm)
    return branches.reshape(len(candidates), -1, BRANCHES, 6).swapaxes(1, 2), down


def _first_free(
    candidates: list[_Candidate],
    paths: np.ndarray,
    down: int,
    clearance: Clearance,
    tight: bool,
    q_now: np.ndarray,
    arm: ArmLengths,
) -> Approach:
    """The nearest of the candidates (W) and branches, paths (W, 8, K, 6), that is reachable and free."""
    grasp = candidates[0].grasp
    with np.errstate(invalid="ignore"):
        reachable = (np.abs(np.diff(paths, axis=2)).max(axis=(2, 3)) < LARGEST_JOINT_STEP) & within_limits(
            paths, arm
        ).all(2)
    if not reachable.any():
        raise MotionError(f"the grasp at {np.round(grasp.pose[:3, 3], 3)} m is out of reach")
    start = paths[:, :, 0]
    # Near the home posture the elbow stays up; then a short path.
    cost = np.abs(wrapped(start - home(arm))).sum(axis=2) + 0.3 * np.abs(start - q_now).max(axis=2)
    order = np.argsort(np.where(reachable, cost, np.inf), axis=None, kind="stable")
    opening = _opening_of(grasp)
    problem: MotionError | None = None
    for index in order[: min(_TRIED_PATHS, int(reachable.sum()))]:
        w, branch = divmod(int(index), BRANCHES)
        path = paths[w, branch]
        trouble = clearance.trouble_at_object(path, opening, tight)
        try:
            if trouble is not None:
                raise MotionError(trouble)
            there = clearance.free_path(q_now, path[0])
        except MotionError as error:
            problem = problem or error
            continue
        candidate = candidates[w]
        T_base_grasp, T_base_tool0 = candidate.T_base_grasp, candidate.T_base_tool0
        closed = down + _CLOSING_STEPS
        to_grasp, to_close, to_lift = path[:down], path[down - 1 : closed], path[closed:]
        return Approach(grasp, opening, T_base_grasp, T_base_tool0, there, to_grasp, to_close, to_lift, arm)
    raise problem or MotionError("no way to the grasp")
