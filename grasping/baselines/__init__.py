"""Other planners with the same interface and output, to be measured against."""

from grasping.baselines.centroid import CentroidPlanner
from grasping.baselines.geograsp import GeoGraspPlanner
from grasping.baselines.learned.planner import LearnedPlanner
from grasping.baselines.single_primitive import SinglePrimitivePlanner

__all__ = ["CentroidPlanner", "GeoGraspPlanner", "LearnedPlanner", "SinglePrimitivePlanner"]
