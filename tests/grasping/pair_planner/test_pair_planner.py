"""Two hands on one object: where its weight is thought to be, pairs that balance it, and why there is none."""

import numpy as np
import pytest
from grasping_shapes import TABLE, box_top, grid, moved

from grasping import ROBOTIQ_2F_140, Arm, CloudError, ConfigError, plan_pair
from grasping.pair_planner.centre_of_mass import footprint
from grasping.pair_planner.pair_planner import LEAST_SHARE, MOST_OFF

EYE = np.array([0.0, -0.4, 1.0])
PLANE = np.array(TABLE)
BEAM = box_top(0.6, 0.05, 0.04)


def turned(points, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T


def arms(reaches=(lambda grasp: True, lambda grasp: True)):
    return [Arm(base, reach) for base, reach in zip(([0, -0.5, 0], [0, 0.5, 0]), reaches, strict=True)]


# ------------------------------------------------------------------------------------------------- centre of mass


def test_of_a_beam_it_is_its_middle():
    found = footprint(moved(BEAM, 0.1, -0.2), PLANE, EYE)
    np.testing.assert_allclose(found.centre, [0.1, -0.2, 0.02], atol=0.002)
    assert found.volume == pytest.approx(0.6 * 0.05 * 0.04, rel=0.08)
    assert abs(found.axes[0, 0]) > 0.999


def test_a_block_on_one_end_draws_it_there():
    block = moved(box_top(0.12, 0.05, 0.04, bottom=False), x=0.2, z=0.04)
    beam, load = 0.6 * 0.05 * 0.04, 0.12 * 0.05 * 0.04
    found = footprint(np.concatenate([BEAM, block]), PLANE, EYE)
    np.testing.assert_allclose(found.centre[:2], [0.2 * load / (beam + load), 0.0], atol=0.004)


def test_a_handle_that_its_head_holds_off_the_table_weighs_no_more_for_it():
    angle, x = (axis.reshape(-1) for axis in np.meshgrid(np.linspace(0, np.pi, 24), np.arange(-0.3, 0.3, 0.003)))
    handle = np.column_stack([x, 0.015 * np.cos(angle), 0.045 + 0.015 * np.sin(angle)])
    head = moved(box_top(0.06, 0.12, 0.06), x=0.33)
    weights = np.array([np.pi * 0.015**2 * 0.6, 0.06 * 0.12 * 0.06])
    found = footprint(np.concatenate([handle, head]), PLANE, EYE)
    assert found.centre[0] == pytest.approx(float(weights @ [0.0, 0.33] / weights.sum()), abs=0.016)


def test_what_a_wall_hides_is_as_on_the_other_side():
    """A floor between two walls, a strip of which behind the nearer wall was not seen."""
    floor = grid((-0.2, 0.2), (-0.03, 0.12), step=0.003)
    walls = [moved(box_top(0.4, 0.02, 0.12), y=side * 0.13) for side in (-1, 1)]
    cloud = np.concatenate([*walls, np.column_stack([floor, np.full(len(floor), 0.01)])])
    known, unknown = footprint(cloud, PLANE, EYE), footprint(cloud, PLANE, None)
    assert known.hidden > unknown.hidden == 0
    assert abs(known.centre[1]) < 0.006
    assert abs(unknown.centre[1]) > abs(known.centre[1])


@pytest.mark.parametrize("degrees", [17, 90, 203])
def test_it_turns_with_the_object(degrees):
    block = moved(box_top(0.12, 0.05, 0.04, bottom=False), x=0.2, z=0.04)
    cloud = np.concatenate([BEAM, block])
    there = footprint(turned(cloud, degrees), PLANE, None).centre
    np.testing.assert_allclose(there, turned(footprint(cloud, PLANE, None).centre[None], degrees)[0], atol=0.003)


# ----------------------------------------------------------------------------------------------------------- pairs


def test_a_beam_is_held_on_both_sides_of_its_middle():
    plan = plan_pair(BEAM, table=TABLE, viewpoint=EYE)
    assert plan.reason is None
    assert plan.best is plan.pairs[0]
    for pair in plan.pairs:
        places = np.array([grasp.pose[:2, 3] for grasp in pair.grasps])
        weighed = np.array(pair.shares) @ places
        np.testing.assert_allclose(weighed[0], plan.outline.centre[0], atol=0.002)  # the lever rule
        assert np.linalg.norm(places[1] - places[0]) == pytest.approx(pair.apart)
        assert min(pair.shares) >= LEAST_SHARE
        assert pair.off <= MOST_OFF
        assert pair.apart >= 0.2
        assert all(0 < grasp.width < ROBOTIQ_2F_140.stroke for grasp in pair.grasps)
        assert all(grasp.pose[2, 2] < -0.999 for grasp in pair.grasps)  # straight down
    assert [pair.score for pair in plan.pairs] == sorted((pair.score for pair in plan.pairs), reverse=True)


def test_each_arm_gets_the_grasp_on_its_side():
    plan = plan_pair(turned(BEAM, 90), table=TABLE, viewpoint=EYE, arms=arms())
    assert plan.best is not None
    near, far = (grasp.pose[1, 3] for grasp in plan.best.grasps)
    assert near < 0 < far


def test_each_arm_gets_only_what_it_reaches():
    first, second = (lambda grasp: grasp.pose[0, 3] > 0.1), (lambda grasp: grasp.pose[0, 3] < -0.1)
    plan = plan_pair(BEAM, table=TABLE, arms=arms((first, second)))
    assert plan.pairs
    assert all(pair.grasps[0].pose[0, 3] > 0.1 and pair.grasps[1].pose[0, 3] < -0.1 for pair in plan.pairs)


@pytest.mark.parametrize(
    ("cloud", "more", "kind", "words"),
    [
        (box_top(0.3, 0.2, 0.04), {}, "no_grasp", "wide"),
        (box_top(0.12, 0.05, 0.04), {}, "too_near", "200 mm"),
        (BEAM, {"arms": arms((lambda grasp: False, lambda grasp: True))}, "out_of_reach", "the arms reach 0,"),
        (BEAM, {"arms": arms((lambda grasp: grasp.pose[0, 3] > 0.02,) * 2)}, "unbalanced", "one hand bears"),
    ],
)
def test_it_says_why_there_is_none(cloud, more, kind, words):
    plan = plan_pair(cloud, table=TABLE, viewpoint=EYE, **more)
    assert plan.best is None
    assert plan.pairs == []
    assert plan.reason is not None
    assert plan.reason.kind == kind
    assert words in plan.reason.text


def test_what_makes_no_sense_is_named():
    with pytest.raises(ConfigError, match="arms: 1"):
        plan_pair(BEAM, table=TABLE, arms=arms()[:1])
    with pytest.raises(ConfigError, match="least_distance = -1"):
        plan_pair(BEAM, table=TABLE, least_distance=-1)
    with pytest.raises(CloudError, match="at least 10"):
        plan_pair(BEAM[:3], table=TABLE)
