"""Whether the arm has room: on its path to an object, and while it grasps it between the others."""

from __future__ import annotations

import numpy as np

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.motion.collision import Surroundings, hits_itself, sphere_gap
from pecgrasp_env.motion.joint_path import MotionError
from pecgrasp_env.motion.rrt_connect import free_path
from pecgrasp_env.robot.arm_lengths import UR5, ArmLengths
from pecgrasp_env.robot.collision_spheres import body
from pecgrasp_env.robot.kinematics import home

_MARGIN_M = 0.008  # from what was seen: noise, the height map's cells, and what was just not seen
_TABLE_M = 0.010
ROBOTS_APART_M = 0.025  # between two robots: each lags by less than a centimetre behind where it is sent
_ALWAYS_FREE = 2  # frames below it, base and shoulder, cannot come near the objects


class Clearance:
    """The room around one object.

    Args:
        points: (M, 3) of the object, base frame, m; none where the arm only moves about.
        others: (K, 3) of all else that was seen.
        plane: the table (4,).
        arm: which one moves.
        robot: (S, 4) x, y, z and radius, m, of spheres that cover another robot where it stands still.
    """

    def __init__(
        self,
        points: np.ndarray,
        others: np.ndarray,
        plane: np.ndarray,
        arm: ArmLengths = UR5,
        robot: np.ndarray | None = None,
    ) -> None:
        self._arm = arm
        self._robot = np.zeros((0, 4)) if robot is None else robot
        self._others = Surroundings(others, plane)
        self._all = Surroundings(np.concatenate([points, others]), plane) if len(points) else self._others

    @property
    def top(self) -> float:
        """Of everything, m above the table."""
        return self._all.top

    def trouble_at_object(self, path: np.ndarray, opening: float, tight: bool) -> str | None:
        """What speaks against a path (K, 6) down to the object and up again with the hand at an opening (m), or None.

        The planner of grasps has seen to the fingertips' room and to the palm's above the object; this is about all
        else: cranks, camera and arm. tight: without a margin to the other objects.
        """
        robot = body(opening, self._arm)
        centres = robot.at(path)
        moving = (robot.frame >= _ALWAYS_FREE) & ~robot.fingertip
        if self._others.near_table(centres[:, moving], robot.radius[moving], _TABLE_M).any():
            return "a link would come too near the table"
        if self._others.hit_by(centres[:, moving], robot.radius[moving], 0.0 if tight else _MARGIN_M).any():
            return "another object is in the arm's way"
        arm = moving & ~robot.gripper
        if self._all.hit_by(centres[:, arm], robot.radius[arm], 0.0).any():
            return "arm or camera would touch the object"
        if self._meets_robot(centres[:, moving], robot.radius[moving]).any():
            return "the other arm is in the way"
        if hits_itself(robot, centres[::2]).any():
            return "the arm would touch itself"
        return None

    def free_path(self, q_start: np.ndarray, q_goal: np.ndarray, opening: float = ROBOTIQ_2F_140.stroke) -> np.ndarray:
        """Joint waypoints (K, 6) past everything, the hand at an opening (m) or narrower.

        Raises MotionError where there is no such path.
        """
        robot = body(opening, self._arm)
        moving = robot.frame >= _ALWAYS_FREE
        radius = robot.radius[moving]

        def free(q: np.ndarray) -> np.ndarray:
            centres = robot.at(q)
            blocked = hits_itself(robot, centres)
            blocked |= self._all.near_table(centres[:, moving], radius, _TABLE_M)
            blocked |= self._all.hit_by(centres[:, moving], radius, _MARGIN_M)
            blocked |= self._meets_robot(centres[:, moving], radius)
            return ~blocked

        return free_path(q_start, q_goal, free, over=(home(self._arm),), limits=self._arm.limits)

    def _meets_robot(self, centres: np.ndarray, radius: np.ndarray) -> np.ndarray:
        """(N,) bool: whether spheres (N, S, 3) of the arm come within the margin of the other robot."""
        if not len(self._robot):
            return np.zeros(len(centres), bool)
        return np.asarray(sphere_gap(centres, radius, self._robot[None, :, :3], self._robot[:, 3]) < ROBOTS_APART_M)


def path_past(
    seen: np.ndarray, plane: np.ndarray | None, q_start: np.ndarray, q_goal: np.ndarray, arm: ArmLengths = UR5
) -> np.ndarray:
    """Joint waypoints (K, 6) with an open, empty hand past points (N, 3), base frame, m, over a table (4,); straight
    where no table is known or no path is found: between two postures high above it that is free as a rule.
    """
    if plane is not None:
        try:
            return Clearance(np.zeros((0, 3)), seen, plane, arm).free_path(q_start, q_goal)
        except MotionError:
            pass
    return np.stack([q_start, q_goal])
