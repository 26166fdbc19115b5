"""Two arms on one table: each comes to its grasp past the other one, and what both hold they carry in step.

An arm's way to its grasp is planned with the other arm standing still, as an obstacle: the first comes while the
second waits, the second past the first, whose hand is at its grasp. Carried, the thing does not turn: both hands move
along the same line at the same time, and every posture of the two on that way is checked against each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from grasping import Grasp, GraspPlan
from pecgrasp_env.motion.clearance import ROBOTS_APART_M
from pecgrasp_env.motion.collision import sphere_gap
from pecgrasp_env.motion.grasp_approach import Approach, grasp_to_carry_out, plan_approach
from pecgrasp_env.motion.joint_path import MotionError, through_poses
from pecgrasp_env.motion.trajectory import time_law
from pecgrasp_env.robot.batch_kinematics import inverse_kinematics_batch
from pecgrasp_env.robot.collision_spheres import body
from pecgrasp_env.robot.kinematics import UP, forward_kinematics
from pecgrasp_env.robot.two_arm_bases import T_WORLD_BASE, in_base, points_in_base

CARRY_SPEED = 0.15  # m/s along the faster axis
CARRY_ACCELERATION = 0.4  # m/s²: a twentieth of the weight, which pads hold by far
_LIFT_STEP_M = 0.05  # of the way up, at which `can_reach` looks
_NOTHING = np.zeros((0, 3))


def can_reach(grasp: Grasp, plane: np.ndarray, goal: np.ndarray, arm: int) -> bool:
    """Whether an arm, 0 or 1, has postures at a grasp, on the way straight up from it, and at the goal's displacement
    (3,) from it; all in the world frame. plane: the table (4,).
    """
    T = in_base(grasp_to_carry_out(grasp, plane)[1], arm)
    R = T_WORLD_BASE[arm][:3, :3]
    rise = np.arange(0.0, goal[2], _LIFT_STEP_M)[:, None] * UP
    offsets = np.concatenate([rise, [goal[2] * UP, goal]]) @ R
    poses = np.repeat(T[None], 2 * len(offsets), axis=0)
    poses[:, :3, 3] += np.concatenate([offsets, offsets])
    poses[len(offsets) :, :3, :3] = poses[len(offsets) :, :3, :3] @ np.diag([-1.0, -1.0, 1.0])  # the hand turned round
    reached = ~np.isnan(inverse_kinematics_batch(poses)).any(axis=2)  # (poses, branches)
    return bool(reached.reshape(2, len(offsets), -1).all(axis=1).any())


def plan_approaches(
    grasps: Mapping[int, Grasp], points: np.ndarray, plane: np.ndarray, q_now: np.ndarray, goal: np.ndarray
) -> dict[int, Approach]:
    """Joint paths of each arm to its grasp, in the order in which they are to be gone; every arm in its base's frame.

    Args:
        grasps: of one arm or of both, world frame.
        points: (M, 3) of the object, world frame. plane: (4,) the table, level.
        q_now: (2, 6) rad, where the arms are.
        goal: (3,) m, how far the object is to be carried.

    Raises:
        MotionError: an arm cannot go there, or the two cannot carry it from there.
    """
    postures = [q[None] for q in np.asarray(q_now, float)]  # of each arm, where the other must pass
    found: dict[int, Approach] = {}
    for arm, grasp in grasps.items():
        local = replace(grasp, pose=in_base(grasp.pose, arm))
        plan = GraspPlan(local, [local], [], None)
        other = _spheres(postures[1 - arm], 1 - arm, arm)
        ground = np.append(plane[:3] @ T_WORLD_BASE[arm][:3, :3], plane[3] + plane[:3] @ T_WORLD_BASE[arm][:3, 3])
        found[arm] = plan_approach(plan, points_in_base(points, arm), _NOTHING, ground, q_now[arm], robot=other)
        postures[arm] = np.concatenate([found[arm].to_grasp[-1:], found[arm].to_close[-1:]])
    closed = {arm: approach.posture_at(approach.grasp.width) for arm, approach in found.items()}
    carry({arm: closed.get(arm, q_now[arm]) for arm in (0, 1)}, tuple(found), goal, dt=0.1)
    return found


def carry(q_start: Mapping[int, np.ndarray], carrying: tuple[int, ...], goal: np.ndarray, dt: float) -> np.ndarray:
    """Joint targets (T, 2, 6), one every `dt` seconds, that carry what the arms hold up and then sideways, unturned.

    Args:
        q_start: of each arm (6,), rad. carrying: which of them hold it; another one stands still.
        goal: (3,) m, world frame; its third value first.

    Raises:
        MotionError: the way leads out of reach, through a jump of the joints, or the arms would meet.
    """
    corners = (np.array([np.zeros(3), goal[2] * UP]), np.array([goal[2] * UP, goal]))
    way = np.concatenate([time_law(line, dt, CARRY_SPEED, CARRY_ACCELERATION) for line in corners])
    targets = np.empty((len(way), 2, 6))
    for arm in (0, 1):
        targets[:, arm] = q_start[arm]
        if arm in carrying:
            poses = np.repeat(forward_kinematics(q_start[arm])[None], len(way), axis=0)
            poses[:, :3, 3] += way @ T_WORLD_BASE[arm][:3, :3]
            targets[:, arm] = through_poses(q_start[arm], poses)[1:]
    if arms_gap(targets).min() < ROBOTS_APART_M:
        raise MotionError("the arms would come too near each other on the way to the goal")
    return targets


def arms_gap(q: np.ndarray) -> np.ndarray:
    """(N,) m between the two arms, their hands open, in postures (N, 2, 6); less than 0 where they meet."""
    one, other = (_centres(q[:, arm], arm) for arm in (0, 1))
    return sphere_gap(one, body(0.14).radius, other, body(0.14).radius)


def _centres(q: np.ndarray, arm: int) -> np.ndarray:
    """(N, S, 3) of an arm's spheres, world frame."""
    T = T_WORLD_BASE[arm]
    return np.asarray(body(0.14).at(q) @ T[:3, :3].T + T[:3, 3])


def _spheres(q: np.ndarray, of_arm: int, in_arm: int) -> np.ndarray:
    """(N · S, 4) spheres of an arm in postures (N, 6), in the frame of the other arm's base."""
    centres = points_in_base(_centres(q, of_arm).reshape(-1, 3), in_arm)
    return np.column_stack([centres, np.tile(body(0.14).radius, len(q))])
