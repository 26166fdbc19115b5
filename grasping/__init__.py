"""Grasp planning on point clouds for two-finger grippers, on NumPy and SciPy; pages need Jinja2, commands Hydra.

plan = CurvaturePlanner(ROBOTIQ_2F_140).plan(points, up=(0, 0, 1))
plan.best.pose, plan.best.width

`compiled` says whether this installation has the compiled kernels of the default planner and of the segmenter; without
them it finds the same with NumPy alone, more slowly.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from grasping.curvature_planner import compiled_backend
from grasping.curvature_planner.planner import CurvaturePlanner
from grasping.errors import CloudError, ConfigError, ModelError
from grasping.grasp import Grasp, GraspPlan, GraspPlanner, RegionReport
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.segmentation import kernels

if TYPE_CHECKING:
    from grasping.baselines import CentroidPlanner, GeoGraspPlanner, LearnedPlanner, SinglePrimitivePlanner
    from grasping.baselines.published.planner import PublishedPlanner
    from grasping.fusion.fuse import Fused, FusedView, fuse
    from grasping.pair_planner.pair_planner import Arm, GraspPair, NoPair, PairPlan, plan_pair
    from grasping.pose.model_planner import ModelPlanner
    from grasping.pose.object_model import ObjectModel, load_models
    from grasping.pose.object_pose import ObjectPose
    from grasping.pose.pose_estimator import PoseEstimator
    from grasping.segmentation.scene import Cut, Rejected, Scene
    from grasping.segmentation.segmenter import Segmenter
    from grasping.selective import Selection, SelectiveGrasper

compiled = compiled_backend.AVAILABLE and kernels.compiled is not None

# These load SciPy, which takes longer than all else here: on their first use.
_LATER = {
    "Fused": "fusion.fuse",
    "FusedView": "fusion.fuse",
    "fuse": "fusion.fuse",
    "PublishedPlanner": "baselines.published.planner",
    "CentroidPlanner": "baselines",
    "GeoGraspPlanner": "baselines",
    "LearnedPlanner": "baselines",
    "SinglePrimitivePlanner": "baselines",
    "Arm": "pair_planner.pair_planner",
    "GraspPair": "pair_planner.pair_planner",
    "NoPair": "pair_planner.pair_planner",
    "PairPlan": "pair_planner.pair_planner",
    "plan_pair": "pair_planner.pair_planner",
    "ModelPlanner": "pose.model_planner",
    "ObjectModel": "pose.object_model",
    "ObjectPose": "pose.object_pose",
    "PoseEstimator": "pose.pose_estimator",
    "load_models": "pose.object_model",
    "Cut": "segmentation.scene",
    "Rejected": "segmentation.scene",
    "Scene": "segmentation.scene",
    "Segmenter": "segmentation.segmenter",
    "Selection": "selective",
    "SelectiveGrasper": "selective",
}

__all__ = [
    "ROBOTIQ_2F_140",
    "Arm",
    "CentroidPlanner",
    "CloudError",
    "ConfigError",
    "CurvaturePlanner",
    "Cut",
    "Fused",
    "FusedView",
    "GeoGraspPlanner",
    "Grasp",
    "GraspPair",
    "GraspPlan",
    "GraspPlanner",
    "Gripper",
    "LearnedPlanner",
    "ModelError",
    "ModelPlanner",
    "NoPair",
    "ObjectModel",
    "ObjectPose",
    "PairPlan",
    "PoseEstimator",
    "PublishedPlanner",
    "RegionReport",
    "Rejected",
    "Scene",
    "Segmenter",
    "Selection",
    "SelectiveGrasper",
    "SinglePrimitivePlanner",
    "compiled",
    "fuse",
    "load_models",
    "plan_pair",
]


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})
