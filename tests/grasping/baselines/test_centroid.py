"""GGA, the centre grasp."""

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, box_top, tips

from grasping import CentroidPlanner, ConfigError


def test_it_holds_the_centroid_from_above_across_the_short_side() -> None:
    cloud = box_top(0.12, 0.04, 0.10, bottom=False)
    plan = CentroidPlanner().plan(cloud, up=UP)
    assert plan.best is not None
    np.testing.assert_allclose(plan.best.pose[:3, 3], cloud.mean(axis=0), atol=1e-12)
    np.testing.assert_allclose(plan.best.pose[:3, 2], [0, 0, -1], atol=1e-12)
    assert abs(plan.best.pose[1, 0]) == pytest.approx(1.0, abs=1e-6)
    assert plan.best.width == pytest.approx(0.04, abs=1e-6)


def test_it_lifts_the_tips_off_a_known_table() -> None:
    plan = CentroidPlanner().plan(box_top(0.12, 0.04, 0.012), table=TABLE)
    assert plan.best is not None
    assert tips(plan.best.pose)[2] == pytest.approx(0.004)


def test_too_wide_an_object_has_a_reason() -> None:
    plan = CentroidPlanner().plan(box_top(0.2, 0.18, 0.05, step=0.006, bottom=False), up=UP)
    assert plan.best is None
    assert "180 mm" in str(plan.reason)


def test_it_needs_to_know_where_up_is() -> None:
    with pytest.raises(ConfigError, match="up"):
        CentroidPlanner().plan(box_top(0.12, 0.04, 0.012))


def test_a_given_heading_is_kept_whatever_lies_there():
    """Closing along the long side of a bar, as far as the heading is horizontal, and too wide where the bar is."""
    bar = box_top(0.12, 0.04, 0.012)
    for heading in ((1, 0, 0), (-0.2, 0, 5)):
        plan = CentroidPlanner(heading=heading).plan(bar, table=TABLE)
        assert abs(plan.best.pose[0, 0]) == pytest.approx(1)
        assert plan.best.pose[:3, 2] == pytest.approx([0, 0, -1])
        assert np.linalg.det(plan.best.pose[:3, :3]) == pytest.approx(1)
        assert plan.best.width == pytest.approx(0.12, abs=0.01)
    assert "mm wide at its centre" in CentroidPlanner(heading=(1, 0, 0)).plan(box_top(0.2, 0.04, 0.012), up=UP).reason


@pytest.mark.parametrize("heading", [(0, 0, 0), (1, 0), (0, np.nan, 1)])
def test_a_heading_that_is_no_direction_is_refused(heading):
    with pytest.raises(ConfigError, match=r"heading = .* must be a direction"):
        CentroidPlanner(heading=heading)
    with pytest.raises(ConfigError, match="points along up"):
        CentroidPlanner(heading=(0, 0, 2)).plan(box_top(0.12, 0.04, 0.012), up=UP)
