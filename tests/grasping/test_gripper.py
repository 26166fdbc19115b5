"""Grippers as data, against the closed forms of their linkages, and as YAML."""

import dataclasses
import math
from pathlib import Path

import pytest
from grasping_shapes import TABLE, UP, box_top, tips
from omegaconf import OmegaConf

from grasping import ROBOTIQ_2F_140, ConfigError, CurvaturePlanner, Gripper


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


GRIPPERS = sorted((Path(__file__).parents[2] / "conf" / "gripper").glob("*.yaml"))


def loaded(path: Path) -> Gripper:
    return Gripper.from_mapping(OmegaConf.to_container(OmegaConf.load(path)))


def test_the_2f_140_of_the_configuration_is_that_of_the_package() -> None:
    assert loaded(GRIPPERS[0].with_name("robotiq_2f_140.yaml")) == ROBOTIQ_2F_140


@pytest.mark.parametrize(("opening", "depth"), [(0.085, 0.13084), (0.0114, 0.14416), (0.0, 0.14388)])
def test_pads_of_the_2f_85_advance_to_where_their_cranks_are_straight(opening: float, depth: float) -> None:
    gripper = loaded(GRIPPERS[0].with_name("robotiq_2f_85.yaml"))
    assert gripper.pad_depth(opening) == pytest.approx(depth, abs=1e-4)


def test_the_2f_85_stops_where_the_maker_stops_its_knuckles() -> None:
    gripper = loaded(GRIPPERS[0].with_name("robotiq_2f_85.yaml"))
    angles = [math.asin((opening + gripper.crank_gap) / (2 * gripper.crank_length)) for opening in (0.0, 0.085)]
    assert angles[1] - angles[0] == pytest.approx(0.8, abs=0.01)  # rad, the driven knuckle's travel


def test_the_panda_hand_holds_with_its_tips_at_the_makers_tool_centre() -> None:
    gripper = loaded(GRIPPERS[0].with_name("panda_hand.yaml"))
    assert gripper.pad_depth(0.0) == gripper.pad_depth(0.08) == 0.1034


@pytest.mark.parametrize("path", GRIPPERS, ids=lambda path: path.stem)
def test_each_gripper_takes_what_fits(path: Path) -> None:
    gripper = loaded(path)
    assert gripper.name == path.stem
    plan = CurvaturePlanner(gripper).plan(box_top(0.12, 0.6 * gripper.stroke, 0.06), up=UP, table=TABLE)
    assert plan.best is not None
    assert plan.best.width == pytest.approx(0.6 * gripper.stroke, abs=0.003)
    assert tips(plan.best.pose, gripper.pad_length)[2] > 0.003


@pytest.mark.parametrize("path", GRIPPERS, ids=lambda path: path.stem)
def test_each_gripper_says_why_it_leaves_what_does_not_fit(path: Path) -> None:
    gripper = loaded(path)
    box = box_top(1.6 * gripper.stroke, 1.5 * gripper.stroke, 0.06)
    plan = CurvaturePlanner(gripper).plan(box, up=UP, table=TABLE)
    assert plan.best is None
    assert plan.reason is not None
    assert "wide" in plan.reason


JAWS = {
    "name": "jaws",
    "stroke": 0.05,
    "finger_width": 0.02,
    "pad_length": 0.02,
    "finger_thickness": 0.01,
    "max_force": 40,
    "min_force": 5,
    "palm_depth": 0.05,
    "depth_offset": 0.09,
}


def test_a_gripper_is_made_of_a_mapping_with_its_defaults() -> None:
    gripper = Gripper.from_mapping(JAWS)
    assert gripper.max_force == 40.0
    assert gripper.crank_length == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"strok": 0.05}, r"gripper\.strok is not a field of a gripper; there are name, stroke"),
        ({"stroke": None}, r"gripper\.stroke = None must be a number"),
        ({"stroke": "50 mm"}, r"gripper\.stroke = '50 mm' must be a number"),
        ({"stroke": True}, r"gripper\.stroke = True must be a number"),
        ({"stroke": 50}, r"gripper\.stroke = 50.0 is more than a metre; lengths are in metres"),
        ({"pad_length": -0.01}, r"gripper\.pad_length = -0.01 must be positive"),
        ({"name": 85}, r"gripper\.name = 85 must be a name"),
        ({"crank_length": 0.02, "crank_gap": -0.05}, r"gripper\.crank_length = 0.02 is too short"),
    ],
)
def test_a_mapping_that_is_no_gripper_is_refused_by_field_and_value(change: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Gripper.from_mapping(JAWS | change)


@pytest.mark.parametrize("missing", ["name", "stroke", "depth_offset"])
def test_a_missing_field_is_named(missing: str) -> None:
    with pytest.raises(ConfigError, match=rf"gripper\.{missing} is missing"):
        Gripper.from_mapping({key: value for key, value in JAWS.items() if key != missing})


def test_what_is_no_mapping_is_no_gripper() -> None:
    with pytest.raises(ConfigError, match="not a mapping"):
        Gripper.from_mapping([1, 2])  # type: ignore[arg-type]  # as a YAML file may hold it
