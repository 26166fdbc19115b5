"""Other planners with the same interface and output, to be measured against."""

from grasping.rivals.centroid import CentroidPlanner
from grasping.rivals.geograsp import GeoGraspPlanner
from grasping.rivals.single_primitive import SinglePrimitivePlanner

__all__ = ["CentroidPlanner", "GeoGraspPlanner", "SinglePrimitivePlanner"]
