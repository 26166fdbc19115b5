"""The planner's hot path in NumPy: the reference of `compiled_backend`, and what plans where nothing was compiled."""

from grasping.curvature_planner.finger_scan import scan
from grasping.curvature_planner.line_of_sight import look
from grasping.curvature_planner.projection import neighbours, place, short_side, thin
from grasping.curvature_planner.ranking import rank
from grasping.curvature_planner.region_report import measure_regions
from grasping.curvature_planner.unseen_back import with_its_back


class NumpyBackend:
    """A `backend.Backend`."""

    short_side = staticmethod(short_side)
    thin = staticmethod(thin)
    place = staticmethod(place)
    neighbours = staticmethod(neighbours)
    look = staticmethod(look)
    with_its_back = staticmethod(with_its_back)
    scan = staticmethod(scan)
    rank = staticmethod(rank)
    measure_regions = staticmethod(measure_regions)
