"""The planner for a real arm on one-sided clouds of simple things that stand on a table."""

import dataclasses

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, axis_angle, box_top, grid, moved, pliers, roof, standing_can, tips

from grasping import ROBOTIQ_2F_140, ConfigError, CurvaturePlanner, Grasp, GraspPlan
from grasping.curvature_planner.contact_refinement import fewest_near_a_pad

X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def best(plan: GraspPlan) -> Grasp:
    assert plan.reason is None
    assert plan.best is not None
    return plan.best


def finger_points(grasp: Grasp, others: np.ndarray) -> int:
    """How many points lie where the fingers are when the pads touch, or above that place."""
    local = (others - grasp.pose[:3, 3]) @ grasp.pose[:3, :3]
    beside = np.abs(local[:, 0]) - grasp.width / 2
    in_finger = (beside > 0.001) & (beside < ROBOTIQ_2F_140.finger_thickness)
    in_finger &= (np.abs(local[:, 1]) < ROBOTIQ_2F_140.finger_width / 2) & (local[:, 2] < 0.0325)
    return int(in_finger.sum())


def test_a_box_is_held_from_above_across_its_narrow_side_near_its_middle() -> None:
    grasp = best(CurvaturePlanner().plan(box_top(0.15, 0.05, 0.06), up=UP, table=TABLE))
    np.testing.assert_allclose(grasp.pose[:3, 2], [0, 0, -1], atol=1e-9)
    assert axis_angle(grasp.pose[:3, 0], Y) < np.deg2rad(3)
    assert grasp.width == pytest.approx(0.05, abs=0.003)
    assert np.linalg.norm(grasp.pose[:2, 3]) < 0.012
    assert np.linalg.det(grasp.pose[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("height", "clear"), [(0.003, 0.001), (0.005, 0.001), (0.010, 0.002), (0.020, 0.004), (0.03, 0.004)]
)
def test_a_flat_object_is_held_with_the_tips_just_above_the_table(height: float, clear: float) -> None:
    grasp = best(CurvaturePlanner().plan(box_top(0.16, 0.03, height), up=UP, table=TABLE))
    assert tips(grasp.pose)[2] == pytest.approx(clear, abs=1e-9)
    assert grasp.terms["tip_height"] == pytest.approx(clear)


def test_a_deep_hold_beside_the_centre_is_better_than_a_shallow_one_at_it() -> None:
    """A low bar with a high block on either end: at its middle the pads reach 9.6 mm deep, at the blocks far more."""
    blocks = [moved(box_top(0.04, 0.03, 0.04), x=side * 0.08) for side in (-1.0, 1.0)]
    bar = np.vstack([box_top(0.12, 0.03, 0.012), *blocks])
    grasp = best(CurvaturePlanner().plan(bar, up=UP, table=TABLE))
    assert abs(grasp.pose[0, 3]) > 0.05
    assert grasp.terms["bite"] == 1.0


def test_where_nothing_is_deep_the_middle_is_held_as_deep_as_may_be() -> None:
    grasp = best(CurvaturePlanner().plan(box_top(0.16, 0.03, 0.010), up=UP, table=TABLE))
    assert grasp.terms["bite"] == 0.0
    assert tips(grasp.pose)[2] == pytest.approx(0.002, abs=1e-9)
    assert abs(grasp.pose[0, 3]) < 0.012


@pytest.mark.parametrize("cloud", [box_top(0.16, 0.03, 0.012), box_top(0.15, 0.11, 0.04), standing_can(0.045, 0.06)])
def test_tips_that_advance_while_they_close_come_down_to_their_height_above_the_table_and_no_lower(
    cloud: np.ndarray,
) -> None:
    gripper = ROBOTIQ_2F_140
    clear = min(0.004, 0.2 * cloud[:, 2].max())
    for grasp in CurvaturePlanner(max_tilt=0.0).plan(cloud, up=UP, table=TABLE).candidates:
        openings = np.linspace(grasp.width, grasp.terms["opening"], 20)
        advance = np.array([gripper.pad_depth(grasp.width) - gripper.pad_depth(opening) for opening in openings])
        assert advance.min() >= 0.0  # the wider open, the farther back: the arm stands still while the hand closes
        assert (tips(grasp.pose)[2] + advance).min() >= clear - 1e-9


def test_tips_stay_where_the_palm_would_touch_a_tall_object() -> None:
    height = 0.25
    grasp = best(CurvaturePlanner().plan(standing_can(0.03, height), up=UP, table=TABLE))
    palm_below_flange = ROBOTIQ_2F_140.palm_depth - ROBOTIQ_2F_140.pad_depth(grasp.width)
    assert grasp.pose[2, 3] - palm_below_flange > height
    assert tips(grasp.pose)[2] < height - 0.02


def test_a_can_is_one_primitive_held_at_its_centre() -> None:
    grasp = best(CurvaturePlanner().plan(standing_can(0.033, 0.1), up=UP, table=TABLE))
    assert grasp.width == pytest.approx(0.066, abs=0.004)
    assert np.linalg.norm(grasp.pose[:2, 3]) < 0.005


def test_pliers_can_be_held_by_both_handles_and_a_wide_pair_by_one() -> None:
    plan = CurvaturePlanner().plan(pliers(), up=UP, table=TABLE)
    widths = [grasp.width for grasp in plan.candidates]
    assert any(abs(width - 0.054) < 0.004 for width in widths)
    handle = box_top(0.100, 0.012, 0.012, step=0.002, bottom=False)
    bridge = box_top(0.020, 0.160, 0.012, step=0.002, bottom=False)
    wide = np.vstack([moved(handle, y=0.074), moved(handle, y=-0.074), moved(bridge, x=0.06)])
    grasp = best(CurvaturePlanner().plan(wide, up=UP, table=TABLE))
    assert grasp.width < 0.03


def test_the_opening_keeps_a_margin_to_the_stroke() -> None:
    planner = CurvaturePlanner(stroke_margin=0.010)
    assert best(planner.plan(box_top(0.3, 0.127, 0.05), up=UP, table=TABLE)).width <= 0.130
    refused = planner.plan(box_top(0.3, 0.135, 0.05), up=UP, table=TABLE)
    assert refused.best is None or refused.best.width <= 0.130


def test_too_wide_an_object_has_a_reason_in_millimetres() -> None:
    plan = CurvaturePlanner(max_tilt=0.0).plan(box_top(0.2, 0.2, 0.05), up=UP, table=TABLE)
    assert plan.best is None
    assert "130 mm" in str(plan.reason)
    assert any(region.verdict.startswith("too wide") for region in plan.regions)


def test_too_flat_an_object_has_a_reason() -> None:
    plan = CurvaturePlanner(max_tilt=0.0).plan(box_top(0.1, 0.05, 0.0014, bottom=False), up=UP, table=TABLE)
    assert plan.best is None
    assert "1 mm high" in str(plan.reason)


def test_what_is_mostly_low_is_held_low_where_one_end_stands_up() -> None:
    """An allen key on its long leg, the short one up: pads 4 mm above the table would miss the middle of its 9 mm."""
    key = np.vstack([box_top(0.16, 0.009, 0.009), moved(box_top(0.009, 0.009, 0.05), x=0.075)])
    grasp = best(CurvaturePlanner().plan(key, up=UP, table=TABLE))
    assert tips(grasp.pose)[2] == pytest.approx(0.2 * 0.009, abs=2e-4)


def test_fingers_come_down_beside_the_object_and_clear_of_its_neighbours() -> None:
    cloud = box_top(0.15, 0.05, 0.06)
    free = best(CurvaturePlanner().plan(cloud, up=UP, table=TABLE))
    # Another box stands 10 mm beside the middle third, where the best grasp was.
    neighbour = moved(box_top(0.05, 0.03, 0.08), y=0.05)
    assert finger_points(free, neighbour) > 0
    held = best(CurvaturePlanner().plan(cloud, up=UP, table=TABLE, obstacles=neighbour))
    assert finger_points(held, neighbour) == 0
    assert finger_points(held, cloud) == 0


@pytest.mark.parametrize("cloud", [box_top(0.12, 0.04, 0.06), box_top(0.06, 0.06, 0.06), standing_can(0.033, 0.1)])
def test_what_stands_under_a_roof_is_held_with_a_tilted_hand_on_sides_that_friction_holds(cloud: np.ndarray) -> None:
    over = roof(0.25)
    refused = CurvaturePlanner(max_tilt=0.0).plan(cloud, up=UP, table=TABLE, obstacles=over)
    assert refused.best is None
    assert "no room for the fingers" in str(refused.reason)
    grasp = best(CurvaturePlanner().plan(cloud, up=UP, table=TABLE, obstacles=over))
    tilt = axis_angle(grasp.pose[:3, 2], np.array(UP))
    assert tilt == pytest.approx(grasp.terms["tilt"])
    assert 0.1 < tilt <= np.deg2rad(35) + 1e-9
    assert finger_points(grasp, over) == 0
    assert abs(grasp.pose[2, 0]) < np.sin(np.arctan(0.4))  # the sides are upright, so the pads nearly are


def test_tilted_grasps_from_all_sides_are_given_where_they_are_asked_for() -> None:
    cloud = box_top(0.12, 0.06, 0.09)
    assert {grasp.terms["tilt"] for grasp in CurvaturePlanner().plan(cloud, up=UP, table=TABLE).candidates} == {0.0}
    plan = CurvaturePlanner(min_tilt=0.2).plan(cloud, up=UP, table=TABLE)
    assert len({tuple(np.round(grasp.pose[:3, 2], 3)) for grasp in plan.candidates}) > 1
    for grasp in plan.candidates:
        assert 0.2 <= grasp.terms["tilt"] == pytest.approx(axis_angle(grasp.pose[:3, 2], np.array(UP)))
    assert [grasp.score for grasp in plan.candidates] == sorted(
        (grasp.score for grasp in plan.candidates), reverse=True
    )
    assert len(CurvaturePlanner(min_tilt=0.2).plan(cloud).candidates) == len(CurvaturePlanner().plan(cloud).candidates)
    with pytest.raises(ConfigError, match="min_tilt"):
        CurvaturePlanner(min_tilt=0.7)


def in_the_palm(grasp: Grasp, others: np.ndarray) -> int:
    """How many points lie where the palm is when the pads touch, or above that place."""
    gripper = ROBOTIQ_2F_140
    local = (others - grasp.pose[:3, 3]) @ grasp.pose[:3, :3]
    under = (np.abs(local[:, 0]) < grasp.width / 2) & (np.abs(local[:, 1]) < gripper.finger_width / 2)
    return int((under & (local[:, 2] < gripper.palm_depth - gripper.pad_depth(grasp.width))).sum())


@pytest.mark.parametrize("height", [0.10, 0.14, 0.18, 0.22, 0.30])
def test_the_palm_does_not_come_down_on_what_hangs_between_the_fingers(height: float) -> None:
    bar = grid((-0.1, 0.1), (-0.012, 0.012), step=0.004)
    bar = np.column_stack([bar, np.full(len(bar), height)])
    grasp = best(CurvaturePlanner().plan(box_top(0.12, 0.06, 0.09), up=UP, table=TABLE, obstacles=bar))
    assert in_the_palm(grasp, bar) == 0
    assert finger_points(grasp, bar) == 0


@pytest.mark.parametrize("seed", range(60))
def test_neither_fingers_nor_palm_come_down_on_a_bar_that_hangs_anywhere(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cloud = box_top(*rng.uniform([0.05, 0.03, 0.03], [0.13, 0.08, 0.1]))
    length, turn = rng.uniform(0.01, 0.12), rng.uniform(0, np.pi)
    bar = grid((-length, length), (-0.02, 0.02), step=0.004)
    bar = bar @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) + rng.uniform(-0.04, 0.04, 2)
    bar = np.column_stack([bar, np.full(len(bar), cloud[:, 2].max() + rng.uniform(0.02, 0.25))])
    for grasp in CurvaturePlanner().plan(cloud, up=UP, table=TABLE, obstacles=bar).candidates:
        assert finger_points(grasp, bar) == 0
        assert in_the_palm(grasp, bar) == 0


def test_no_room_anywhere_is_said() -> None:
    cloud = box_top(0.06, 0.05, 0.03)
    ring = grid((-0.10, 0.10), (-0.10, 0.10), step=0.003)
    ring = ring[(np.abs(ring[:, 0]) > 0.035) | (np.abs(ring[:, 1]) > 0.030)]
    wall = np.column_stack([ring, np.full(len(ring), 0.12)])
    plan = CurvaturePlanner().plan(cloud, up=UP, table=TABLE, obstacles=wall)
    assert plan.best is None
    assert "no room for the fingers" in str(plan.reason)
    assert {region.verdict for region in plan.regions} == {"no room for the fingers"}


def test_a_wedge_that_friction_cannot_hold_is_not_held_across_its_faces() -> None:
    # A triangle seen from above whose sides meet at 70 degrees.
    points = grid((0.0, 0.08), (-0.06, 0.06), step=0.002)
    points = points[np.abs(points[:, 1]) < np.tan(np.deg2rad(35)) * points[:, 0]]
    cloud = np.column_stack([points, np.full(len(points), 0.04)])
    planner = CurvaturePlanner(friction=0.3, max_tilt=0.0)  # tilted pads could hold it by its two sharp edges
    for grasp in planner.plan(cloud, up=UP, table=TABLE).candidates:
        assert axis_angle(grasp.pose[:3, 0], Y) > np.deg2rad(10)


def test_a_cylinder_lying_on_the_table_is_held_across_although_its_lower_half_is_unseen() -> None:
    radius = 0.03
    angle = np.arange(np.deg2rad(-50), np.deg2rad(91), 0.06)  # 0 is up; seen from +y, so the far lower side is missing
    along = np.arange(-0.07, 0.071, 0.003)
    a, x = (axis.reshape(-1) for axis in np.meshgrid(angle, along))
    cloud = np.column_stack([x, radius * np.sin(a), radius + radius * np.cos(a)])
    grasp = best(CurvaturePlanner().plan(cloud, up=UP, table=TABLE))
    assert axis_angle(grasp.pose[:3, 0], Y) < np.deg2rad(4)
    assert tips(grasp.pose)[2] < radius - 0.005
    assert grasp.width == pytest.approx(radius * (1 + np.sin(np.deg2rad(50))), abs=0.004)


def test_every_candidate_explains_itself_and_the_best_comes_first() -> None:
    plan = CurvaturePlanner().plan(box_top(0.15, 0.05, 0.06), up=UP, table=TABLE)
    scores = [grasp.score for grasp in plan.candidates]
    assert scores == sorted(scores, reverse=True)
    assert plan.best is plan.candidates[0]
    for grasp in plan.candidates:
        assert 0.0 <= grasp.score <= 1.0
        for term in ("contact", "bite", "angle", "overlap", "centre", "room", "narrow", "whole"):
            assert 0.0 <= grasp.terms[term] <= 1.0
        assert grasp.width <= grasp.terms["opening"] <= ROBOTIQ_2F_140.stroke
        assert grasp.region is None or grasp.region < len(plan.regions)


def test_regions_are_even_slabs_that_cover_the_object() -> None:
    cloud = box_top(0.15, 0.05, 0.06)
    plan = CurvaturePlanner().plan(cloud, up=UP, table=TABLE)
    whole = [region for region in plan.regions if region.cluster is None]
    assert len(whole) == round(0.15 / ROBOTIQ_2F_140.finger_width)
    assert sum(len(region.points) for region in whole) == len(cloud)
    lengths = [np.ptp(region.points[:, 0]) for region in whole]
    assert max(lengths) < 0.027
    assert min(lengths) > 0.020


def test_without_up_a_whole_box_is_held_across_its_narrow_side() -> None:
    faces = box_top(0.15, 0.05, 0.03)
    grasp = best(CurvaturePlanner().plan(np.vstack([faces, -faces + [0.0, 0.0, 0.03]])))
    assert min(axis_angle(grasp.pose[:3, 0], axis) for axis in (Y, np.array([0.0, 0.0, 1.0]))) < np.deg2rad(4)
    assert grasp.width < 0.055


def test_a_narrower_gripper_refuses_what_a_wider_one_takes() -> None:
    small = dataclasses.replace(ROBOTIQ_2F_140, stroke=0.085)
    cloud = standing_can(0.045, 0.08)
    assert best(CurvaturePlanner().plan(cloud, up=UP, table=TABLE)).width > 0.08
    assert CurvaturePlanner(small).plan(cloud, up=UP, table=TABLE).best is None


def test_a_table_alone_says_where_up_is() -> None:
    cloud = box_top(0.15, 0.05, 0.06)
    with_up = best(CurvaturePlanner().plan(cloud, up=UP, table=TABLE))
    np.testing.assert_array_equal(with_up.pose, best(CurvaturePlanner().plan(cloud, table=TABLE)).pose)
    flipped = best(CurvaturePlanner().plan(cloud, up=UP, table=(0.0, 0.0, -2.0, 0.0)))
    np.testing.assert_array_equal(with_up.pose, flipped.pose)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("side_clearance", -0.001),
        ("tip_clearance", float("inf")),
        ("stroke_margin", 0.2),
        ("friction", 0.0),
        ("headings", 1),
        ("max_tilt", 2.0),
        ("n_points", 0),
    ],
)
def test_a_parameter_that_makes_no_sense_is_named(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=name):
        CurvaturePlanner(**{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "change", [{"finger_width": 1e-6}, {"finger_width": 1e-300}, {"palm_depth": 0.17, "pad_length": 0.02}]
)
def test_a_gripper_that_can_hold_nothing_is_refused_by_the_field(change: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=f"gripper.{next(iter(change))} = "):
        CurvaturePlanner(dataclasses.replace(ROBOTIQ_2F_140, **change))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("scene", "name"),
    [
        ({"up": (0, 0, 0)}, "up"),
        ({"up": (0, 1)}, "up"),
        ({"up": "above"}, "up"),
        ({"table": (0, 0, 1)}, "table"),
        ({"table": (0, 0, 0, 1)}, "table"),
        ({"table": (0, 0, float("nan"), 1)}, "table"),
        ({"up": (1, 0, 0), "table": TABLE}, "more than 45"),
    ],
)
def test_a_scene_that_makes_no_sense_is_named(scene: dict, name: str) -> None:
    with pytest.raises(ConfigError, match=name):
        CurvaturePlanner().plan(box_top(0.1, 0.05, 0.05), **scene)


@pytest.mark.parametrize(("step", "fewest"), [(0.002, 5), (0.004, 5), (0.0045, 4), (0.006, 3), (0.02, 3)])
def test_a_pad_needs_fewer_points_where_the_cloud_has_fewer(step: float, fewest: int) -> None:
    """A pad of 27 mm may touch 162 mm²: at a step of 4.5 mm a surface has eight points there, half of them must be."""
    slab = grid((-0.1, 0.1), (-0.1, 0.1), step=step)
    assert fewest_near_a_pad(np.column_stack([slab, np.zeros(len(slab))]).T, 0.027) == fewest


def test_without_extent_a_pad_needs_the_usual_number_of_points() -> None:
    assert fewest_near_a_pad(np.zeros((3, 9)), 0.027) == 5
