"""What a hand does with an object: takes hold of it, lifts it, tips off what lies on it, puts it down beside.

What moves is a generator, part of an episode (`scripted.ScriptedPolicy`), and a ``yield`` is a control step. Whether
something is held is read off the opening and the force, as on the real gripper.
"""

from __future__ import annotations

import numpy as np

from pecgrasp_env.motion.grasp_approach import Approach
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.policy.arm_primitives import ArmSteps, Steps
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.observation import RobotObservation
from pecgrasp_env.policy.perception import View
from pecgrasp_env.policy.put_down import plan_put_down
from pecgrasp_env.policy.seen_objects import SeenObject
from pecgrasp_env.policy.tip_off import TippedLift, plan_tipped_lift
from pecgrasp_env.robot.arm_lengths import ArmLengths
from pecgrasp_env.robot.kinematics import UP

__all__ = ["LIFT_SPEED", "is_held", "lift", "put_down", "take_hold", "tipped_lift"]

LIFT_SPEED = 0.6
_APPROACH_SPEED = 0.5
_EMPTY_OPENING_M = 0.002  # the thinnest thing that counts as held
_LEAST_FORCE_N = 2.0  # between the pads; the grip's own limit is never below 10 N
_LOST_SHARE = 0.5  # of the opening with which it was first held
_SLIDING_S = 0.5  # for what lies on a tipped object to slide off
_TOO_WIDE_M = 0.020  # beyond the planned width: there is something else between the pads


def is_held(opening: float, force: float | None) -> bool:
    """Whether something is between the pads of a hand that has closed to `opening`, m, with `force`, N, if it says."""
    return opening >= _EMPTY_OPENING_M and (force is None or force >= _LEAST_FORCE_N)


def take_hold(arm: ArmSteps, log: PolicyLog, approach: Approach, observation: RobotObservation) -> Steps:
    """Go there and close. Returns why it failed, or None, and the last observation."""
    log.doing = "moving over the object"
    observation = yield from arm.go(approach.to_pregrasp, observation, opening=approach.opening)
    log.doing = "coming down"
    observation = yield from arm.go(
        approach.to_grasp, observation, opening=approach.opening, speed=_APPROACH_SPEED, careful=True
    )
    if arm.blocked(observation, approach.opening):
        return "touched something on the way down", observation
    log.doing = "closing"
    observation = yield from arm.close(observation, approach.posture_at)
    log.held_m, log.held_n = observation.opening, observation.force
    if not is_held(observation.opening, observation.force):
        return "closed on nothing", observation
    if observation.opening > approach.grasp.width + _TOO_WIDE_M:
        found, planned = observation.opening * 1e3, approach.grasp.width * 1e3
        return f"holds something {found:.0f} mm wide where {planned:.0f} mm were planned", observation
    return None, observation


def tipped_lift(
    arm: ArmSteps,
    log: PolicyLog,
    approach: Approach,
    taken: SeenObject,
    upon: list[np.ndarray],
    others: list[np.ndarray],
    view: View,
) -> tuple[str | None, TippedLift | None]:
    """How to lift what is held so that what lies ``upon`` it slides off; where there is no room, why not, for
    lifted otherwise that would go up with it.
    """
    q, on_it, around = np.asarray(arm.command[:6], float), np.concatenate(upon), np.concatenate(others)
    try:
        tipped = plan_tipped_lift(q, approach, taken.points, on_it, around, view.plane)
    except MotionError as error:
        return f"something lies on it, and there is no room to tip it off: {error}", None
    log.doubts.append("something lies on it: it is tipped while it is lifted")
    return None, tipped


def lift(
    arm: ArmSteps, log: PolicyLog, approach: Approach, tipped: TippedLift | None, observation: RobotObservation
) -> Steps:
    """Lift what is held. Returns why that failed, or None, the joint path (K, 6), and the last observation."""
    closed = observation.opening
    up = np.concatenate([arm.command[None, :6], approach.to_lift])
    if tipped is not None:
        log.doing = "tipping it"
        observation = yield from arm.go(tipped.tip, observation, opening=0.0, speed=LIFT_SPEED)
        observation = yield from arm.wait(observation, _SLIDING_S)
        up = tipped.up
    log.doing = "lifting"
    observation = yield from arm.go(up, observation, opening=0.0, speed=LIFT_SPEED)
    observation = yield from arm.squeeze(observation)
    held = observation.opening >= _LOST_SHARE * closed and is_held(observation.opening, observation.force)
    if tipped is not None:
        up = np.concatenate([tipped.tip, tipped.up])
    return (None if held else "lost while lifting"), up, observation


def put_down(
    arm: ArmSteps,
    log: PolicyLog,
    held: SeenObject,
    lifted: np.ndarray,
    views: list[View],
    lengths: ArmLengths,
    observation: RobotObservation,
) -> Steps:
    """Carry what is held to the free table and let go. Returns why that failed, or None, and the observation."""
    log.doing = "putting it down beside"
    plane = np.append(UP, 0.0) if views[-1].plane is None else views[-1].plane
    seen = np.concatenate([view.surface for view in views])
    try:
        way = plan_put_down(held.points, lifted[0], observation.q, observation.opening, seen, plane, lengths)
    except MotionError as error:
        observation = yield from arm.go(lifted[::-1], observation, opening=0.0, speed=LIFT_SPEED)
        return f"no place to put down what lies on it: {error}", observation
    observation = yield from arm.go(way.over, observation, opening=0.0, speed=LIFT_SPEED)
    observation = yield from arm.lower(way.down, observation)
    observation = yield from arm.let_go(observation, way.opening)
    observation = yield from arm.rise(observation)
    log.cleared += 1
    return None, observation
