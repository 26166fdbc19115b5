"""Other planners with the same interface and output, to be measured against."""

from grasping.rivals.centroid import CentroidPlanner

__all__ = ["CentroidPlanner"]
