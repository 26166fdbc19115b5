"""The dissertation's chapter 5: what it does on shapes like those of its figures, and each of its open values."""

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, axis_angle, box_top, moved, pliers, ringed_cylinder, tips, whole_cylinder

from grasping import ROBOTIQ_2F_140, CloudError, ConfigError, CurvaturePlanner, PublishedPlanner


def test_a_cylinder_is_one_primitive_held_at_its_centroid() -> None:
    # The same rings in each of five slabs: on random points the share of flat neighbourhoods, 0.39, scatters about the
    # border between cylinder and box.
    cloud = ringed_cylinder(0.033, 0.1349, rings=20, around=12)
    plan = CurvaturePlanner.published().plan(cloud)
    assert plan.best is not None
    assert plan.best.kind == "primitive"
    assert plan.reason is None
    assert len({region.primitive for region in plan.regions}) == 1
    np.testing.assert_allclose(plan.best.pose[:3, 3], cloud.mean(axis=0), atol=1e-9)
    assert abs(plan.best.pose[:3, 0] @ [0, 1, 0]) < 0.1  # closes across its axis
    assert plan.best.width == pytest.approx(0.066, abs=0.002)


def test_a_small_object_is_held_at_its_centre_without_regions() -> None:
    rng = np.random.default_rng(0)
    cloud = rng.uniform(-0.01, 0.01, (200, 3))
    plan = CurvaturePlanner.published().plan(cloud)
    assert plan.best is not None
    np.testing.assert_allclose(plan.best.pose[:3, 3], cloud.mean(axis=0), atol=1e-9)
    assert plan.best.kind == "primitive"
    assert plan.regions == []


def test_slabs_and_their_clusters_are_both_candidates_so_pliers_can_be_held_by_both_handles() -> None:
    plan = PublishedPlanner().plan(pliers(step=0.004))
    through_handles = [region for region in plan.regions if region.cluster is not None]
    assert through_handles
    for part in through_handles:
        whole = next(r for r in plan.regions if r.slab == part.slab and r.cluster is None)
        assert whole.width > 0.050
        assert part.width < 0.020
        assert len(part.points) < len(whole.points)
        assert whole.verdict == part.verdict == "candidate"


def test_candidates_are_ranked_by_the_sum_of_lateral_curvatures() -> None:
    plan = CurvaturePlanner.published().plan(pliers(step=0.004))
    assert plan.best is plan.candidates[0]
    curvatures = [grasp.terms["curvature"] for grasp in plan.candidates]
    assert curvatures == pytest.approx(sorted(curvatures), abs=1e-9)
    for grasp in plan.candidates:
        assert grasp.region is not None
        assert plan.regions[grasp.region].curvature == grasp.terms["curvature"]


def test_regions_below_the_curvature_floor_are_named_and_not_taken() -> None:
    cloud = pliers(step=0.004)
    low = PublishedPlanner().plan(cloud)
    floor = float(np.median([region.curvature for region in low.regions]))
    plan = PublishedPlanner(curvature_floor=floor).plan(cloud)
    for region in plan.regions:
        assert (region.verdict == "candidate") == (region.curvature > floor)
    assert all(grasp.terms["curvature"] > floor for grasp in plan.candidates)


def test_without_a_floor_even_a_perfectly_flat_region_is_taken() -> None:
    wide, narrow = (box_top(0.08, width, 0.0, step=0.006, bottom=False) for width in (0.06, 0.02))
    plate = np.vstack([wide, moved(narrow, x=0.08)])
    assert {region.verdict for region in PublishedPlanner().plan(plate).regions} == {"candidate"}
    refused = PublishedPlanner.released().plan(plate)
    assert refused.best is None
    assert "lateral curvature of 0.016 or less" in str(refused.reason)


def test_the_rest_of_the_length_is_a_region_only_where_asked_for() -> None:
    cloud = pliers(step=0.004)
    whole = int(np.ptp(cloud[:, 0]) / 0.027)
    assert {region.slab for region in PublishedPlanner.released().plan(cloud).regions} == set(range(whole + 1))
    for rest in ("both ends", "lower end"):
        plan = PublishedPlanner(rest=rest).plan(cloud)  # type: ignore[arg-type]
        assert {region.slab for region in plan.regions} == set(range(whole))
    middle = np.concatenate([region.points for region in PublishedPlanner().plan(cloud).regions])
    left = middle[:, 0].min() - cloud[:, 0].min(), cloud[:, 0].max() - middle[:, 0].max()
    assert left[0] == pytest.approx(left[1], abs=0.005)


def test_the_values_of_the_public_release_are_at_hand_and_can_be_changed() -> None:
    released = PublishedPlanner.released(curvature_floor=0.0)
    assert (released.rest, released.thinning, released.neighbour_divisors) == ("last slab", "every", (6, 3))
    assert released.curvature_floor == 0.0


def test_lengths_may_drift_along_consecutive_regions_but_not_where_all_must_be_alike() -> None:
    # A cone: 5 mm less from slab to slab.
    cone = ringed_cylinder(1.0, 0.1349, rings=30, around=16)
    cone[:, [0, 2]] *= 0.034 - 0.0925 * cone[:, 1:2]
    consecutive = PublishedPlanner(n_points=1000).plan(cone)
    assert consecutive.best is not None
    assert consecutive.best.kind == "primitive"
    every = PublishedPlanner(n_points=1000, alike="all").plan(cone)
    assert every.best is not None
    assert every.best.kind == "region"


def test_the_default_planner_hands_on_what_the_text_leaves_open() -> None:
    planner = CurvaturePlanner.published(neighbour_divisors=(6, 3), cluster_tolerance=0.03)
    assert isinstance(planner, PublishedPlanner)
    assert (planner.neighbour_divisors, planner.cluster_tolerance) == ((6, 3), 0.03)
    with pytest.raises(ConfigError, match="neighbour_divisors"):
        CurvaturePlanner.published(neighbour_divisors=(0, 4))


def test_a_region_is_turned_to_its_own_axes() -> None:
    # A tapered body with a bent handle: in the handle's slabs the object's axes are not the region's.
    body = box_top(0.080, 0.060, 0.03, step=0.004)
    handle = box_top(0.120, 0.020, 0.03, step=0.004)
    angle = np.deg2rad(20)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    plan = PublishedPlanner().plan(np.vstack([body, moved(handle, x=0.07) @ turn.T]))
    assert plan.best is not None
    closings = {tuple(np.round(grasp.pose[:3, 0], 3)) for grasp in plan.candidates}
    assert len(closings) > 1


def test_a_large_primitive_has_a_reason_with_its_width() -> None:
    plan = CurvaturePlanner.published(n_points=1000).plan(ringed_cylinder(0.09, 0.4049, rings=30, around=12))
    assert plan.best is None
    assert plan.candidates == []
    assert str(plan.reason).startswith("the object is one ")
    assert "140 mm" in str(plan.reason)


def test_known_up_makes_the_approach_straight_down_and_keeps_the_tips_off_the_table() -> None:
    plan = PublishedPlanner().plan(box_top(0.15, 0.03, 0.02, step=0.004), up=UP, table=TABLE)
    assert plan.best is not None
    np.testing.assert_allclose(plan.best.pose[:3, 2], [0, 0, -1], atol=1e-12)
    assert axis_angle(plan.best.pose[:3, 0], np.array([0.0, 1.0, 0.0])) < 0.2
    assert tips(plan.best.pose)[2] == pytest.approx(0.004)


def test_points_in_any_order_give_the_same_plan() -> None:
    cloud = pliers(step=0.003)
    cloud = cloud + np.random.default_rng(1).normal(scale=2e-4, size=cloud.shape)
    shuffled = cloud[np.random.default_rng(2).permutation(len(cloud))]
    first, second = PublishedPlanner().plan(cloud), PublishedPlanner().plan(shuffled)
    assert first.best is not None
    assert second.best is not None
    np.testing.assert_allclose(first.best.pose, second.best.pose, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("n_points", 3),
        ("neighbour_divisors", (4, 0)),
        ("thinning", "some"),
        ("rest", "somewhere"),
        ("similar_length", -1.0),
        ("curvature_floor", float("nan")),
        ("cluster_tolerance", 0.0),
        ("cluster_points", (10, 5)),
        ("least_neighbours", (3, 2)),
        ("alike", "some"),
        ("tip_clearance", -0.1),
    ],
)
def test_a_parameter_that_makes_no_sense_is_named(name: str, value: object) -> None:
    with pytest.raises(ConfigError, match=name):
        PublishedPlanner(ROBOTIQ_2F_140, **{name: value})  # type: ignore[arg-type]


def test_a_cloud_with_nan_is_refused() -> None:
    cloud = whole_cylinder(0.03, 0.1)
    cloud[3, 1] = np.nan
    with pytest.raises(CloudError, match=r"first 3"):
        PublishedPlanner().plan(cloud)
