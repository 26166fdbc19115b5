"""Jain and Argall: which primitive one-sided clouds are, and from where it is held."""

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, box_top, moved, tips

from grasping import SinglePrimitivePlanner


def seen_ball(radius: float, count: int = 600) -> np.ndarray:
    """The upper half of a ball that lies on the table: points in equal areas along a spiral."""
    z = (np.arange(count) + 0.5) / count
    angle = np.arange(count) * (np.pi * (3 - np.sqrt(5)))
    across = np.sqrt(1 - z**2)
    return radius * np.column_stack([across * np.cos(angle), across * np.sin(angle), z + 1])


def seen_can(radius: float, height: float, count: int = 600) -> np.ndarray:
    """A standing can's top and the half of its wall that faces the camera, evenly covered by random points."""
    rng = np.random.default_rng(0)
    on_top = rng.random(count) < radius / (radius + height)
    angle = rng.uniform(0, np.where(on_top, 2, 1) * np.pi)
    out = np.where(on_top, radius * np.sqrt(rng.random(count)), radius)
    z = np.where(on_top, height, rng.uniform(0, height, count))
    return np.column_stack([out * np.cos(angle), out * np.sin(angle), z])


def test_a_ball_is_a_sphere_held_across_its_diameter_at_its_centre() -> None:
    plan = SinglePrimitivePlanner().plan(seen_ball(0.035), up=UP, table=TABLE)
    assert plan.best is not None
    assert [region.primitive for region in plan.regions] == ["sphere"]
    assert plan.best.width == pytest.approx(0.070, abs=0.002)
    np.testing.assert_allclose(plan.best.pose[:2, 3], 0.0, atol=0.003)
    assert [grasp.terms["side"] for grasp in plan.candidates] == [0.0] * 2 + [1.0] * 4
    assert plan.candidates[2].pose[2, 3] == pytest.approx(0.035, abs=0.003)


def test_a_standing_can_is_a_cylinder_held_from_its_side_and_then_from_its_top() -> None:
    plan = SinglePrimitivePlanner().plan(seen_can(0.033, 0.12), up=UP, table=TABLE)
    assert [region.primitive for region in plan.regions] == ["cylinder"]
    assert [grasp.terms["side"] for grasp in plan.candidates] == [1.0] * 4 + [0.0] * 2
    for grasp in plan.candidates:
        assert grasp.kind == "primitive"
        assert grasp.width == pytest.approx(0.066, abs=0.002)
        assert abs(grasp.pose[2, 0]) < 1e-9  # closes level
        assert grasp.pose[2, 2] == pytest.approx(-1.0 if grasp.terms["side"] == 0.0 else 0.0, abs=1e-9)
    assert plan.candidates[0].pose[2, 3] == pytest.approx(0.06, abs=0.002)


def test_a_lying_carton_is_a_box_held_from_its_top_across_its_narrow_side() -> None:
    plan = SinglePrimitivePlanner().plan(box_top(0.12, 0.08, 0.02, step=0.002), up=UP, table=TABLE)
    assert [region.primitive for region in plan.regions] == ["box"]
    assert plan.best is not None
    np.testing.assert_allclose(plan.best.pose[:3, 2], [0, 0, -1], atol=1e-9)
    assert abs(plan.best.pose[1, 0]) > 0.98
    assert plan.best.width == pytest.approx(0.08, abs=0.01)
    assert plan.candidates[1].width > plan.best.width


def test_only_sides_that_the_gripper_spans_are_candidates() -> None:
    plan = SinglePrimitivePlanner().plan(box_top(0.19, 0.10, 0.08, step=0.005), up=UP, table=TABLE)
    assert plan.candidates
    assert all(grasp.width < 0.14 for grasp in plan.candidates)
    # From the top and from either end, but not along its length.
    assert sorted(grasp.terms["side"] for grasp in plan.candidates) == [0.0, 1.0, 1.0]


def test_too_large_a_primitive_has_a_reason_with_its_name_and_width() -> None:
    plan = SinglePrimitivePlanner().plan(seen_ball(0.09), up=UP)
    assert plan.best is None
    assert plan.reason == "the object is one sphere, 179 mm across; the gripper opens 140 mm"
    assert plan.regions[0].verdict == "too wide: 179 mm"


def test_fingers_keep_off_a_known_table() -> None:
    plan = SinglePrimitivePlanner().plan(box_top(0.12, 0.08, 0.02, step=0.004), table=TABLE)
    for grasp in plan.candidates:
        lowest = grasp.pose[2, 3] - 0.0135 if grasp.terms["side"] else tips(grasp.pose)[2]
        assert lowest >= 0.004 - 1e-12
    assert plan.best is not None
    assert tips(plan.best.pose)[2] == pytest.approx(0.004)


def test_an_object_of_two_parts_is_taken_for_one() -> None:
    """Its known weakness: two posts with nothing between them are held at their common centre, in the air."""
    post = box_top(0.012, 0.012, 0.10, step=0.003)
    plan = SinglePrimitivePlanner().plan(np.vstack([moved(post, y=0.04), moved(post, y=-0.04)]), up=UP, table=TABLE)
    assert plan.best is not None
    assert abs(plan.best.pose[1, 3]) < 0.01


def test_without_up_the_approach_is_from_the_seen_side() -> None:
    plan = SinglePrimitivePlanner().plan(seen_ball(0.03) @ np.diag([2.0, 1.3, 1.0]))
    assert plan.best is not None
    assert plan.best.pose[2, 2] < -0.9
