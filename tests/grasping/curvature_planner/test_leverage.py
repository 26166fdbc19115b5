"""Nearness to the centre of mass: as ever for what is light, more where the object is long and heavy."""

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, box_top

from grasping import CurvaturePlanner
from grasping.curvature_planner.scoring import FAR_FROM_CENTRE, WEIGHTS, leverage


def bar(length, breadth, height):
    """From a bar's centre to its farthest corner, m, and its volume, m³."""
    return 0.5 * np.hypot(length, breadth), length * breadth * height


def test_what_is_light_or_short_is_weighed_as_ever():
    for size in ((0.15, 0.03, 0.02), (0.06, 0.06, 0.06)):
        assert leverage(*bar(*size)) == (FAR_FROM_CENTRE, WEIGHTS["centre"])


def test_a_long_object_has_no_place_beyond_the_scale_and_the_term_falls_by_as_much_a_metre():
    far, weight = leverage(*bar(0.30, 0.02, 0.01))
    assert far == pytest.approx(np.hypot(0.15, 0.01))
    assert weight / far == pytest.approx(WEIGHTS["centre"] / FAR_FROM_CENTRE)


def test_a_heavy_one_counts_by_the_torque_of_its_weight():
    """0.30 × 0.04 × 0.06 m at 500 kg/m³ are 0.36 kg: held at the end 0.534 N·m, 2.67 times what counts as held."""
    far, weight = leverage(*bar(0.30, 0.04, 0.06))
    assert weight / far == pytest.approx(2.67 * WEIGHTS["centre"] / FAR_FROM_CENTRE, rel=0.01)
    far, weight = leverage(*bar(0.30, 0.12, 0.10))
    assert weight / far == pytest.approx(3.0 * WEIGHTS["centre"] / FAR_FROM_CENTRE)


def test_the_kernels_weigh_a_heavy_bar_as_numpy_does():
    cloud = box_top(0.30, 0.06, 0.06)
    compiled, numpy = (CurvaturePlanner(compiled=each).plan(cloud, up=UP, table=TABLE) for each in (None, False))
    assert compiled.best is not None
    assert np.abs(compiled.best.pose[:2, 3]).max() < 0.01
    assert [grasp.score for grasp in compiled.candidates] == [grasp.score for grasp in numpy.candidates]
