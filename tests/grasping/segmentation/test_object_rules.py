"""What is on the table and what is beside it, of clusters whose place is known."""

from itertools import pairwise

import numpy as np
import pytest

from grasping.segmentation.frame import Frame
from grasping.segmentation.object_rules import Limits, ObjectRules, Tabletop

LIMITS = Limits(min_points=10, min_area=1e-4, min_height=0.002, max_extent=0.45, least_thing=0.5)


def patch(x: tuple[float, float], y: tuple[float, float], z: float) -> np.ndarray:
    """(N, 3) points of a level rectangle, 5 mm apart."""
    across, along = np.meshgrid(np.arange(*x, 0.005), np.arange(*y, 0.005))
    return np.stack([across.ravel(), along.ravel(), np.full(across.size, z)], axis=1)


@pytest.mark.parametrize("neighbours", [True, False])
def test_a_thing_is_on_the_table_where_others_hide_the_table_about_it(neighbours: bool) -> None:
    # A table of 0.6 m of which a corner of 0.2 m is not seen: three things stand there, or one beyond what is hidden.
    table = np.concatenate([patch((0.0, 0.4), (0.0, 0.6), 0.0), patch((0.4, 0.6), (0.0, 0.4), 0.0)])
    clusters = [patch((0.51, 0.6), (0.51, 0.6), 0.05)]
    if neighbours:
        clusters += [patch((0.51, 0.6), (0.4, 0.51), 0.08), patch((0.4, 0.51), (0.51, 0.6), 0.08)]
    points = np.concatenate([table, *clusters])
    frame = Frame(points + np.array([0.0, 0.0, 1e-6]), (0.0, 2.0))
    ends = np.cumsum([len(table), *map(len, clusters)])
    number = [np.arange(start, end) for start, end in pairwise(ends)]
    plane = np.array([0.0, 0.0, 1.0, 0.0])
    rules = ObjectRules(frame, LIMITS, Tabletop(frame, plane, points[:, 2], np.arange(len(table))))
    found = rules.sort(number)
    assert found.number == ([0, 1, 2] if neighbours else [])
    assert [entry.why for entry in frame.rejected if entry.what == "cluster"] == (
        [] if neighbours else ["beside the table"]
    )
