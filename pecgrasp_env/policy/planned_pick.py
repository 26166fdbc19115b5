"""What `ScriptedPolicy.plan_only` answers: where the hand must go, for people who move an arm themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from grasping import GraspPlan
from pecgrasp_env.motion.grasp_approach import Approach
from pecgrasp_env.policy.seen_objects import SeenObject


@dataclass(frozen=True)
class PlannedPick:
    """What to pick up and how. All poses in the robot's base frame, metres, (4, 4) float64.

    objects: what was seen, with the class probabilities of each. chosen: index of the one to pick up, or None. clears:
    that it is not the asked-for one but lies on it, and has to be put down beside first. plan: its grasps. approach:
    joint paths of the arm with this project's gripper, where its joint angles were given. confidence: that the
    asked-for object is of its class. reason: why there is no grasp or no path, or None. doubt: why the scene should be
    looked at from another view before anything is touched, or before it is believed that the class is not there; None
    where what was seen is enough. absent: nothing that was seen may be of the class.
    T_base_grasp: pads' centre, z the approach, x the closing direction, the fingertips clear of the table.
    T_base_tool0: the flange there at contact; at another opening the pads are there where the flange is
    `pad_depth(width) - pad_depth(opening)` in front of it, so draw it back while the hand closes. width, opening: m, at
    contact and to come in with. They are None where there is no grasp.
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
    clears: bool = False
    doubt: str | None = None
    absent: bool = False
