"""The 2F-140 as data, against the closed form of its linkage."""

import dataclasses

import pytest

from grasping import ROBOTIQ_2F_140, ConfigError


@pytest.mark.parametrize(
    ("opening", "depth"), [(0.140, 0.1717), (0.1285, 0.1770), (0.100, 0.1871), (0.060, 0.1959), (0.0, 0.2007)]
)
def test_pads_advance_while_the_2f_140_closes(opening: float, depth: float) -> None:
    assert ROBOTIQ_2F_140.pad_depth(opening) == pytest.approx(depth, abs=1e-4)


def test_an_opening_measured_slightly_outside_the_stroke_is_clipped() -> None:
    assert ROBOTIQ_2F_140.pad_depth(-0.001) == ROBOTIQ_2F_140.pad_depth(0.0)
    assert ROBOTIQ_2F_140.pad_depth(0.145) == ROBOTIQ_2F_140.pad_depth(0.140)


def test_prismatic_jaws_keep_their_depth() -> None:
    jaws = dataclasses.replace(ROBOTIQ_2F_140, crank_length=0.0, crank_gap=0.0)
    assert jaws.pad_depth(0.0) == jaws.pad_depth(0.14) == jaws.depth_offset


@pytest.mark.parametrize(
    ("field", "value"),
    [("stroke", 0.0), ("stroke", float("nan")), ("finger_width", -0.01), ("crank_length", 0.05), ("palm_depth", 0.3)],
)
def test_a_gripper_that_makes_no_sense_is_refused_by_field(field: str, value: float) -> None:
    with pytest.raises(ConfigError, match=field):
        dataclasses.replace(ROBOTIQ_2F_140, **{field: value})


def test_least_force_above_the_greatest_is_refused() -> None:
    with pytest.raises(ConfigError, match="min_force"):
        dataclasses.replace(ROBOTIQ_2F_140, min_force=200.0)
