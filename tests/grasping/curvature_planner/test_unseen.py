"""What the camera did not see is not free: shells have an inside, holes hide things, and hands come from its side."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from depth_views import brick, camera_at, can, cup, seen_by, table_in
from grasping_shapes import TABLE, UP, box_top, grid, moved
from numpy.typing import NDArray

from grasping import ROBOTIQ_2F_140, ConfigError, CurvaturePlanner, Grasp, GraspPlan

FloatArray = NDArray[np.float64]
Solid = Callable[[FloatArray], NDArray[np.bool_]]


def swept(grasp: Grasp) -> FloatArray:
    """Places (N, 3) in both fingers on their way down and while they close, 2 mm and more beside the contact."""
    hand = ROBOTIQ_2F_140
    half = 0.5 * grasp.terms["opening"] + hand.finger_thickness
    x, y = np.arange(0.5 * grasp.width + 0.002, half, 0.003), np.linspace(-0.5, 0.5, 7) * hand.finger_width
    z = np.arange(-0.1, 0.5 * hand.pad_length, 0.004)
    one = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.vstack([one, one * [-1, 1, 1]]) @ grasp.pose[:3, :3].T + grasp.pose[:3, 3]


def enters(plan: GraspPlan, solid: Solid, T: FloatArray) -> list[int]:
    """How many places of each candidate's fingers' way are inside of the true object. T: of the cloud's frame, z up."""
    return [int(np.count_nonzero(solid(swept(each) @ T[:3, :3].T + T[:3, 3]))) for each in plan.candidates]


def cylinder(radius: float, height: float) -> Solid:
    return lambda p: (np.hypot(p[:, 0], p[:, 1]) < radius - 0.002) & (p[:, 2] > 0.0) & (p[:, 2] < height - 0.002)


def block(length: float, width: float, height: float) -> Solid:
    half = np.array([length, width]) / 2 - 0.002
    return lambda p: (np.abs(p[:, :2]) < half).all(axis=1) & (p[:, 2] > 0.0) & (p[:, 2] < height - 0.002)


def best(plan: GraspPlan) -> Grasp:
    assert plan.best is not None, plan.reason
    return plan.best


@pytest.mark.parametrize("elevation", [4.0, 15.0, 35.0])
def test_a_bottle_of_which_only_the_front_is_seen_is_held_across_and_no_finger_enters_it(elevation: float) -> None:
    T = camera_at(elevation)
    plan = CurvaturePlanner().plan(seen_by(can(0.034, 0.2), T), table=table_in(T))  # the origin is the camera
    assert best(plan).width == pytest.approx(0.068, abs=0.004)
    across = T[:3, :3] @ best(plan).pose[:3, 0]
    assert abs(across[0]) > 0.9  # the line of sight is along y
    assert best(plan).terms["assumed"] < 0.005
    assert best(plan).terms["seen"] > 0.7
    assert enters(plan, cylinder(0.034, 0.2), T) == [0] * len(plan.candidates)


def test_a_width_that_is_only_assumed_says_so_and_costs() -> None:
    """The side of a carton seen from straight ahead: how deep it is nobody saw."""
    T = camera_at(4.0)
    plan = CurvaturePlanner().plan(seen_by(brick(0.15, 0.05, 0.1), T), table=table_in(T))
    grasp = best(plan)  # across it is too wide
    assert grasp.terms["assumed"] > 0.8 * grasp.width
    assert grasp.terms["seen"] < 0.5
    assert enters(plan, block(0.15, 0.05, 0.1), T) == [0] * len(plan.candidates)
    assert grasp.score < 0.7 < best(CurvaturePlanner().plan(box_top(0.15, 0.05, 0.1), up=UP, table=TABLE)).score


def test_a_camera_told_in_a_frame_of_the_world_gives_the_grasp_of_its_own_frame() -> None:
    T = camera_at(20.0, azimuth=40.0)
    own = seen_by(can(0.03, 0.15), T)
    one = best(CurvaturePlanner().plan(own, table=table_in(T)))
    other = best(CurvaturePlanner().plan(own @ T[:3, :3].T + T[:3, 3], table=TABLE, viewpoint=T[:3, 3]))
    np.testing.assert_allclose((T @ one.pose)[:3, 3], other.pose[:3, 3], atol=0.004)
    assert abs((T @ one.pose)[:3, 0] @ other.pose[:3, 0]) > 0.97
    assert one.width == pytest.approx(other.width, abs=0.002)


def test_behind_an_object_is_unknown_which_costs_but_is_not_refused() -> None:
    T = camera_at(45.0)
    plan = CurvaturePlanner().plan(seen_by(brick(0.15, 0.05, 0.1), T), table=table_in(T))
    assert abs((T[:3, :3] @ best(plan).pose[:3, 0])[1]) > 0.98  # across its narrow side, along the line of sight
    assert best(plan).terms["seen"] < 0.8
    assert best(plan).terms["assumed"] < 0.015
    assert enters(plan, block(0.15, 0.05, 0.1), T) == [0] * len(plan.candidates)


@pytest.mark.parametrize("elevation", [10.0, 25.0, 40.0])
@pytest.mark.parametrize("size", [(0.05, 0.12, 0.16), (0.12, 0.05, 0.16), (0.12, 0.10, 0.2)])
def test_a_finger_goes_in_blind_only_where_nothing_else_holds(size: tuple[float, ...], elevation: float) -> None:
    T = camera_at(elevation, azimuth=-70.0)
    plan = CurvaturePlanner().plan(seen_by(brick(*size), T), table=table_in(T))
    seen = np.array([grasp.terms["seen"] for grasp in plan.candidates])
    assert len(seen)
    assert (seen >= 0.1).all() or (seen < 0.1).all()


@pytest.mark.parametrize("elevation", [30.0, 60.0])
def test_the_rim_of_a_bowl_that_is_seen_from_within_and_without_is_still_held(elevation: float) -> None:
    T = camera_at(elevation)
    grasp = best(CurvaturePlanner().plan(seen_by(cup(0.08, 0.06), T), table=table_in(T)))
    assert grasp.width < 0.012
    assert grasp.terms["seen"] > 0.9
    assert grasp.terms["assumed"] < 0.005


def test_a_hole_in_the_depth_is_no_room_for_a_finger() -> None:
    """A box whose dark middle gave no depth: its halves are not two things with room between them."""
    T = camera_at(50.0)
    cloud = seen_by(brick(0.15, 0.09, 0.08), T)
    world = cloud @ T[:3, :3].T + T[:3, 3]
    dark = np.abs(world[:, 0]) < 0.035
    lines = world[dark] - T[:3, 3]
    ends = T[:3, 3] + lines * (T[2, 3] / -lines[:, 2:])  # where they would meet the table
    scene = {"up": UP, "table": TABLE, "viewpoint": T[:3, 3]}
    solid, straight = block(0.15, 0.09, 0.08), np.eye(4)
    blind = CurvaturePlanner().plan(world[~dark], **scene)
    assert max(enters(blind, solid, straight)) > 0  # taken for free, the hole would let a finger in
    plan = CurvaturePlanner().plan(world[~dark], **scene, unseen=ends)
    assert best(plan).width == pytest.approx(0.09, abs=0.015)
    assert enters(plan, solid, straight) == [0] * len(plan.candidates)


def test_views_from_both_sides_leave_nothing_to_assume() -> None:
    cameras = [camera_at(15.0, azimuth) for azimuth in (-90.0, 90.0)]
    views = [seen_by(can(0.034, 0.2), T) @ T[:3, :3].T + T[:3, 3] for T in cameras]
    scene = {"up": UP, "table": TABLE, "viewpoint": [T[:3, 3] for T in cameras]}
    plan = CurvaturePlanner().plan(np.vstack(views), **scene)
    assert best(plan).width == pytest.approx(0.068, abs=0.004)
    assert max(grasp.terms["assumed"] for grasp in plan.candidates) < 0.004
    assert best(plan).terms["seen"] > 0.9


@pytest.mark.parametrize("elevation", [10.0, 30.0, 50.0, 75.0])
@pytest.mark.parametrize("surface", [can(0.04, 0.1), cup(0.045, 0.09), brick(0.12, 0.05, 0.06)])
def test_without_a_table_a_hand_comes_from_the_cameras_side(surface: FloatArray, elevation: float) -> None:
    cloud = seen_by(surface, camera_at(elevation, azimuth=25.0))
    plan = CurvaturePlanner().plan(cloud)
    sight = cloud.mean(axis=0) / np.linalg.norm(cloud.mean(axis=0))
    for grasp in plan.candidates:
        assert grasp.pose[:3, 2] @ sight > np.cos(np.deg2rad(46))
    assert best(plan).score > 0.5


def test_the_origin_is_taken_for_a_camera_only_where_it_can_be_one() -> None:
    """Not for a whole model before it, whose points hide each other, nor for a place in the table's plane."""
    whole = can(0.03, 0.1)[::7] @ camera_at(40.0)[:3, :3] + [0.0, 0.0, 0.6]
    on_table = moved(box_top(0.12, 0.05, 0.06), x=0.4)
    for cloud, scene in ((whole, {}), (on_table, {"up": UP}), (on_table, {"up": UP, "table": TABLE})):
        plan = CurvaturePlanner().plan(cloud, **scene)
        assert best(plan).terms["seen"] == 1.0
        assert best(plan).terms["assumed"] == 0.0


@pytest.mark.parametrize("viewpoint", [[0.0, 0.0], [[[0.0, 0.0, 1.0]]], [np.nan, 0.0, 1.0], "above", []])
def test_a_viewpoint_that_is_no_place_is_named(viewpoint: object) -> None:
    with pytest.raises(ConfigError, match="viewpoint = "):
        CurvaturePlanner().plan(box_top(0.12, 0.05, 0.06), up=UP, viewpoint=viewpoint)  # type: ignore[arg-type]


SLAB = np.column_stack([grid((-0.05, 0.05), (-0.05, 0.05), step=0.003), np.full(34 * 34, 0.06)])


@pytest.mark.parametrize(
    "stray",
    [
        [[0.0, -0.008, 0.1], [0.0005, 0.0, 0.1], [0.0, 0.008, 0.1]],
        np.column_stack([np.zeros(12), np.linspace(-0.015, 0.015, 12), np.full(12, 0.1)]),
    ],
    ids=["three points", "a streak"],
)
def test_almost_nothing_holds_nothing(stray: object) -> None:
    plan = CurvaturePlanner().plan(np.vstack([SLAB, stray]), up=UP)
    assert plan.best is None
    assert plan.reason is not None
    assert "almost nothing" in plan.reason


@pytest.mark.parametrize("thick", [0.003, 0.008])
def test_what_is_thin_and_real_is_held(thick: float) -> None:
    grasp = best(CurvaturePlanner().plan(box_top(0.1, thick, 0.04), up=UP, table=TABLE))
    assert grasp.width == pytest.approx(thick, abs=0.002)
    assert grasp.terms["narrow"] < 0.9
