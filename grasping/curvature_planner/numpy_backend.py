"""The planner's hot path in NumPy: the functions that `kernels` has compiled, under the same names."""

from grasping.curvature_planner.finger_scan import scan
from grasping.curvature_planner.projection import place, short_side, thin
from grasping.curvature_planner.ranking import rank
from grasping.curvature_planner.region_report import measured_parts

__all__ = ["measured_parts", "place", "rank", "scan", "short_side", "thin"]
