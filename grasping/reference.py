"""The planner's hot path in NumPy: the functions that `kernels` has compiled, under the same names."""

from grasping.profiles import scan
from grasping.projection import place, short_side, thin
from grasping.ranking import rank
from grasping.survey import measured_parts

__all__ = ["measured_parts", "place", "rank", "scan", "short_side", "thin"]
