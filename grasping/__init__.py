"""Grasp planning on point clouds for two-finger grippers: NumPy and SciPy only.

plan = CurvaturePlanner(ROBOTIQ_2F_140).plan(points, up=(0, 0, 1))
plan.best.pose, plan.best.width
"""

from grasping.errors import CloudError, ConfigError
from grasping.fusion import Fused, FusedView, fuse
from grasping.grasp import Grasp, GraspPlan, RegionReport
from grasping.gripper import ROBOTIQ_2F_140, Gripper
from grasping.planner import CurvaturePlanner
from grasping.published import PublishedPlanner
from grasping.rivals import CentroidPlanner, GeoGraspPlanner, SinglePrimitivePlanner
from grasping.scene import Rejected, Scene, Segmenter
from grasping.selective import Selection, SelectiveGrasper

__all__ = [
    "ROBOTIQ_2F_140",
    "CentroidPlanner",
    "CloudError",
    "ConfigError",
    "CurvaturePlanner",
    "Fused",
    "FusedView",
    "GeoGraspPlanner",
    "Grasp",
    "GraspPlan",
    "Gripper",
    "PublishedPlanner",
    "RegionReport",
    "Rejected",
    "Scene",
    "Segmenter",
    "Selection",
    "SelectiveGrasper",
    "SinglePrimitivePlanner",
    "fuse",
]
