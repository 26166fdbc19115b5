"""The planner's hot path in NumPy: the reference of `compiled_backend`, and what plans where nothing was compiled."""

from grasping.curvature_planner.finger_scan import scan
from grasping.curvature_planner.projection import place, short_side, thin
from grasping.curvature_planner.ranking import rank
from grasping.curvature_planner.region_report import measure_regions


class NumpyBackend:
    """A `backend.Backend`."""

    short_side = staticmethod(short_side)
    thin = staticmethod(thin)
    place = staticmethod(place)
    scan = staticmethod(scan)
    rank = staticmethod(rank)
    measure_regions = staticmethod(measure_regions)
