"""What two arms choose on a cloud, and what they need to see."""

import numpy as np
import pytest

from pecgrasp_env.policy.observation import ObservationError
from pecgrasp_env.policy.two_arms.choices import METHODS
from pecgrasp_env.policy.two_arms.looking import Seen, read_dual_observation
from pecgrasp_env.robot.two_arm_bases import MIDDLE, T_WORLD_BASE

GOAL = np.array([0.05, 0.0, 0.2])
EYE = np.array([MIDDLE[0], -0.3, 1.05])


@pytest.fixture(scope="module")
def board():
    """A plank across the line between the arms, from above."""
    x, y = (axis.reshape(-1) for axis in np.meshgrid(np.arange(-0.04, 0.041, 0.003), np.arange(-0.3, 0.301, 0.003)))
    points = np.column_stack([x + MIDDLE[0], y, np.full(len(x), 0.03)])
    return Seen(points, np.array([0.0, 0.0, 1.0, 0.0]), EYE)


def choose(method, seen, seed=0):
    return METHODS[method](seen, GOAL, np.random.default_rng(seed))


def places(holds):
    return {arm: grasp.pose[:3, 3].tolist() for arm, grasp in holds.items()}


def test_a_pair_has_the_weight_between_its_hands(board):
    choice = choose("pair", board)
    assert choice.reason is None
    np.testing.assert_allclose(choice.centre[:2], MIDDLE, atol=0.003)
    for holds in choice.holds:
        assert sorted(holds) == [0, 1]
        one, other = (grasp.pose[1, 3] for grasp in holds.values())
        assert one * other < 0


def test_two_random_regions_are_a_draw_without_a_look_at_the_weight(board):
    drawn = [places(holds) for holds in choose("random", board).holds]
    assert drawn == [places(holds) for holds in choose("random", board).holds]
    assert drawn[0] != places(choose("random", board, seed=1).holds[0])
    assert len(drawn) > len(choose("pair", board).holds)
    assert any(min(y[1] for y in each.values()) > 0.0 for each in drawn)  # both hands on one side of it


def test_a_single_grasp_is_one_arms_and_the_nearer_ones_first(board):
    beside = Seen(board.points + np.array([0.1, 0.0, 0.0]), board.plane, EYE)
    choice = choose("single", beside)
    assert choice.centre is None
    assert all(len(holds) == 1 for holds in choice.holds)
    assert list(choice.holds[0]) == [1]
    grasp = choice.holds[0][1]
    near, far = (np.linalg.norm(T_WORLD_BASE[arm][:3, 3] - grasp.pose[:3, 3]) for arm in (1, 0))
    assert near < far


def test_where_there_is_nothing_to_hold_it_says_why(board):
    panel = Seen(
        np.concatenate([board.points + np.array([dx, 0.0, 0.0]) for dx in (-0.08, 0.0, 0.08)]), board.plane, EYE
    )
    for method in METHODS:
        choice = choose(method, panel)
        assert choice.holds == []
        assert "wide" in choice.reason


def test_an_observation_without_depth_is_named():
    with pytest.raises(ObservationError, match="sensor_data/stand_camera"):
        read_dual_observation({"sensor_data": {"stand_camera": {}}})
    with pytest.raises(ObservationError, match="obs has no sensor_data"):
        read_dual_observation({"agent": {}})
