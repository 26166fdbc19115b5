"""The dissertation's first system (chapter 3.1): find the known object's pose, put its whole model there, grasp that.

What the camera did not see of a known object is known all the same: no back has to be assumed, no defect of the sensor
misleads. Where no pose is accepted the seen cloud is planned on, and the plan says why.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.curvature_planner.planner import CurvaturePlanner
from grasping.errors import ModelError
from grasping.grasp import GraspPlan, GraspPlanner
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.pose.object_model import ObjectModel, load_models
from grasping.pose.object_pose import ObjectPose
from grasping.pose.pose_estimator import PoseEstimator
from grasping.validation import object_cloud, sight

FloatArray = NDArray[np.float64]

BESIDE = 0.01  # m off the model, from which a seen point is of something else, and in the way


class ModelPlanner:
    """Plan grasps on the whole model of a known object, at the pose in which it is found in the cloud.

    models: a folder of meshes (`load_models`), or the models. classes, scale, allow_open: as `load_models` takes them.
    settings: what `CurvaturePlanner` takes. Raises ModelError as `load_models` does, ConfigError as the planner does.

    A plan's `source` says which model was found and how well, or why none was and the cloud itself was planned on.
    Terms of a grasp are the `CurvaturePlanner`'s, and of a pose that was found its `inlier_share` and `residual`, m.
    """

    FELL_BACK = "the cloud: "  # how `source` begins where no pose was accepted

    def __init__(
        self,
        gripper: Gripper = ROBOTIQ_2F_140,
        *,
        models: str | os.PathLike[str] | Sequence[ObjectModel],
        classes: Sequence[str] | None = None,
        scale: float = 1.0,
        allow_open: bool = False,
        **settings: Any,
    ) -> None:
        if isinstance(models, (str, os.PathLike)):
            models = load_models(models, classes=classes, scale=scale, allow_open=allow_open)
        if not models:
            raise ModelError("models: none; planner=default plans on clouds alone")
        self.gripper = gripper
        self.models = tuple(models)
        self._planner = CurvaturePlanner(gripper, **settings)
        self._all = PoseEstimator(self.models)
        self._of_class = {
            label: self._all.of_class(label) for label in dict.fromkeys(model.label for model in self.models)
        }

    def plan(
        self,
        points: ArrayLike,
        *,
        up: ArrayLike | None = None,
        table: ArrayLike | None = None,
        obstacles: ArrayLike | None = None,
        viewpoint: ArrayLike | None = None,
        unseen: ArrayLike | None = None,
        label: str | None = None,
    ) -> GraspPlan:
        """As `GraspPlanner.plan`. label: the class whose models are tried, None: all; of several viewpoints (V, 3) the
        model must not hide what the last saw.
        """
        cloud = object_cloud(points)
        pose, why = self._pose(cloud, viewpoint, table, label)
        if pose is None:
            plan = self._planner.plan(
                cloud, up=up, table=table, obstacles=obstacles, viewpoint=viewpoint, unseen=unseen
            )
            return replace(plan, source=f"{self.FELL_BACK}{why}")
        T = pose.T_camera_object
        whole = pose.model.points @ T[:3, :3].T + T[:3, 3]
        beside = cloud[cKDTree(whole).query(cloud)[0] > BESIDE]
        others = [] if obstacles is None else [np.asarray(obstacles, np.float64).reshape(-1, 3)]
        plan = self._planner.plan(whole, up=up, table=table, obstacles=np.concatenate([*others, beside]))
        measures = {"inlier_share": pose.inlier_share, "residual": pose.residual}
        grasps = [replace(grasp, terms={**grasp.terms, **measures}) for grasp in plan.candidates]
        source = f"the model {pose.model.name}, on which {pose.inlier_share:.0%} of the cloud lies"
        return replace(plan, best=grasps[0] if grasps else None, candidates=grasps, source=source)

    def of_class(self, label: str) -> OfClass:
        """The same for what is known to be of a class; where none of the models is, it plans on the cloud."""
        return OfClass(self, label)

    def _pose(
        self, cloud: FloatArray, viewpoint: ArrayLike | None, table: ArrayLike | None, label: str | None
    ) -> tuple[ObjectPose | None, str]:
        """The best pose of a model in the cloud, or None and why there is none."""
        estimator = self._all if label is None else self._of_class.get(label)
        if estimator is None:
            return None, f"no model is of class {label}"
        eyes, _ = sight(viewpoint, None)
        found = estimator.estimate(cloud, viewpoint=None if eyes is None else eyes[-1], table=table)
        return (found[0], "") if found else (None, estimator.reason)


@dataclass(frozen=True)
class OfClass:
    """A `ModelPlanner` that is told what it plans on."""

    planner: ModelPlanner
    label: str

    def plan(self, points: ArrayLike, **scene: Any) -> GraspPlan:
        """As `ModelPlanner.plan`, with the class that is known."""
        return self.planner.plan(points, label=self.label, **scene)


def told_class(planner: GraspPlanner, label: str) -> GraspPlanner:
    """The planner for what is known to be of a class: one that has models looks among those of it."""
    return planner.of_class(label) if isinstance(planner, ModelPlanner) else planner
