"""What each of several planners would do first with what one camera saw of an object: a grasp a planner and scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from grasping import ROBOTIQ_2F_140, GraspPlanner
from grasping.pose.model_planner import told_class
from pecgrasp_env.capture.grasps.antipodal import OPEN_MARGIN_M, TABLE
from pecgrasp_env.capture.grasps.candidates import Candidates
from pecgrasp_env.motion.grasp_approach import clear_of_table
from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.robot.kinematics import UP

__all__ = ["FirstGrasps"]


class FirstGrasps:
    """In place of a `CandidateSampler`: the best grasp of each planner that has one.

    planners: Hydra-like mappings with ``_target_``, by name; their order is the code of a grasp's sampler.
    """

    def __init__(self, planners: Mapping[str, Mapping[str, Any]]) -> None:
        from hydra.utils import instantiate

        self._planners: list[GraspPlanner] = [instantiate(settings) for settings in planners.values()]

    def draw(
        self,
        model: ObjectModel,
        T_world_object: np.ndarray,
        points: np.ndarray,
        viewpoint: np.ndarray,
        count: int,
        rng: np.random.Generator,
    ) -> Candidates:
        """Of an object seen as points (N, 3) from a viewpoint (3,), world; the planners are told no more than that, but
        one that has models the class.
        """
        told = [told_class(planner, model.class_name) for planner in self._planners]
        plans = [planner.plan(points, up=UP, table=TABLE, viewpoint=viewpoint) for planner in told]
        found = [(code, plan.best) for code, plan in enumerate(plans) if plan.best is not None]
        stroke = ROBOTIQ_2F_140.stroke
        openings = [min(stroke, grasp.terms.get("opening", grasp.width + OPEN_MARGIN_M)) for _, grasp in found]
        poses = [
            clear_of_table(grasp.pose, opening, TABLE) for (_, grasp), opening in zip(found, openings, strict=True)
        ]
        return Candidates(
            np.array(poses).reshape(-1, 4, 4),
            np.array([grasp.width for _, grasp in found]),
            np.array(openings),
            np.array([code for code, _ in found], np.uint8),
        )
