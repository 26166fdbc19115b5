"""What `ScriptedPolicy.plan_only` answers: where the hand must go, for people who move an arm themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grasping import GraspPlan
from pecgrasp_env.motion.grasp_approach import Approach, grasp_to_carry_out, plan_approach
from pecgrasp_env.motion.trajectory import MotionError
from pecgrasp_env.policy.perception import SeenObject


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
