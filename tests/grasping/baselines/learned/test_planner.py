"""Hands on local frames and proposed ones: what has room and what is judged; how a judge orders other candidates."""

import numpy as np
import pytest
from grasping_shapes import TABLE, UP, axis_angle, box_top, tips, whole_cylinder
from numpy.typing import NDArray

from grasping import CloudError, ConfigError, CurvaturePlanner, LearnedPlanner
from grasping.baselines.learned.hand_room import HandSpace
from grasping.baselines.learned.local_frames import local_frames, turned_hands
from grasping.gripper import ROBOTIQ_2F_140

FloatArray = NDArray[np.float64]
EYE = np.array([0.3, -0.2, 0.6])


def level(cloud: FloatArray, poses: FloatArray, widths: FloatArray) -> FloatArray:
    """Better the more nearly straight down."""
    assert cloud[:, 2].min() >= -1e-9
    return np.clip(-poses[:, 2, 2], 0.0, 1.0)


def downward(x: float, z: float, half_turned: bool = False) -> FloatArray:
    """Straight down, closing along y."""
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    pose[:3, 3] = x, 0.0, z
    return pose @ np.diag([-1.0, -1.0, 1.0, 1.0]) if half_turned else pose


def test_frames_of_a_cylinder_have_its_axis() -> None:
    eye = np.array([1.0, 0.0, 0.1])
    samples, frames = local_frames(whole_cylinder(0.03, 0.2, count=1500), eye, 20)
    middle = np.abs(samples[:, 1]) < 0.06
    for sample, frame in zip(samples[middle], frames[middle], strict=True):
        assert axis_angle(frame[:, 1], np.array([0.0, 1.0, 0.0])) < 0.3
        assert frame[:, 2] @ (sample - eye) > 0.0
        assert np.linalg.det(frame) == pytest.approx(1.0)


def test_turned_hands_keep_the_axis_and_move_along_the_closing_direction() -> None:
    turns, offsets = np.array([0.0, np.pi / 2]), np.array([0.0, 0.05])
    rotations, origins = turned_hands(np.zeros((1, 3)), np.eye(3)[None], turns, offsets)
    np.testing.assert_allclose(rotations[:, :, 1], np.tile([0.0, 1.0, 0.0], (4, 1)), atol=1e-12)
    np.testing.assert_allclose(origins[[0, 2]], 0.0, atol=1e-12)
    np.testing.assert_allclose(origins[[1, 3]], [[0.05, 0.0, 0.0], [0.0, 0.0, -0.05]], atol=1e-12)


def test_a_hand_goes_down_to_the_table_beside_a_bar_and_to_the_top_of_what_is_too_wide() -> None:
    pose, opening = downward(0.0, 0.2), np.array([0.14])
    half = 0.5 * ROBOTIQ_2F_140.pad_length
    for width, height, tips_at in ((0.04, 0.03, 0.004), (0.15, 0.03, 0.03)):
        space = HandSpace(ROBOTIQ_2F_140, box_top(0.16, width, height), np.empty((0, 3)), TABLE, 0.004)
        room = space.room(pose[None, :3, :3], pose[None, :3, 3], opening, np.inf)
        assert 0.2 - room.advance[0] - half == pytest.approx(tips_at, abs=1e-9)
        assert room.reach[0] == pytest.approx(height - tips_at, abs=1e-9)
    wall = np.column_stack([np.zeros(20), np.full(20, 0.075), np.linspace(0.0, 0.1, 20)])
    space = HandSpace(ROBOTIQ_2F_140, box_top(0.16, 0.04, 0.03), wall, TABLE, 0.004)
    room = space.room(pose[None, :3, :3], pose[None, :3, 3], opening, np.inf)
    assert 0.2 - room.advance[0] - half == pytest.approx(0.1, abs=1e-9)
    assert room.reach[0] < 0.0


def test_a_bar_is_held_across_its_middle_clear_of_the_table() -> None:
    plan = LearnedPlanner(scores=level).plan(box_top(0.16, 0.04, 0.03), up=UP, table=TABLE, viewpoint=EYE)
    assert plan.best is not None
    assert plan.best.score == max(grasp.score for grasp in plan.candidates) > 0.9
    for grasp in plan.candidates:
        assert 0.0 < grasp.width < grasp.terms["opening"] <= 0.14
        assert tips(grasp.pose)[2] >= 0.0
        assert grasp.terms["tilt"] <= np.radians(60) + 1e-9
        assert grasp.terms["reach"] >= 0.01 - 1e-9
    across = [grasp for grasp in plan.candidates if abs(grasp.pose[1, 0]) > 0.95]
    assert across
    assert min(grasp.width for grasp in across) == pytest.approx(0.04, abs=0.006)


def test_the_frame_does_not_matter_and_the_judge_sees_a_level_one() -> None:
    turn, shift = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([0.3, -0.1, 0.7])
    bar, normal = box_top(0.16, 0.04, 0.03) @ turn.T + shift, turn @ UP
    table = np.append(normal, -normal @ shift)
    plan = LearnedPlanner(scores=level).plan(bar, up=normal, table=table, viewpoint=turn @ EYE + shift)
    assert plan.best is not None
    assert plan.best.score > 0.9
    assert plan.best.pose[:3, 2] @ normal < -0.9


def test_proposed_hands_are_drawn_back_and_turned_ones_are_one() -> None:
    """One in the table, its half turn, and one beside the bar that holds nothing."""
    proposals = np.array([downward(0.02, 0.01), downward(0.02, 0.01, half_turned=True), downward(0.3, 0.05)])
    planner = LearnedPlanner(scores=level, propose=lambda cloud: proposals)
    plan = planner.plan(box_top(0.16, 0.04, 0.03), up=UP, table=TABLE)
    assert len(plan.candidates) == 1
    assert plan.candidates[0].pose[:3, 3] == pytest.approx([0.02, 0.0, 0.004 + 0.0325], abs=3e-3)
    nothing = LearnedPlanner(scores=level, propose=lambda cloud: proposals[2:]).plan(box_top(0.16, 0.04, 0.03), up=UP)
    assert nothing.best is None
    assert "1 hands" in str(nothing.reason)


def test_a_judge_reorders_what_the_default_planner_found() -> None:
    cloud = box_top(0.16, 0.04, 0.03)
    plain = CurvaturePlanner().plan(cloud, up=UP, table=TABLE)

    def leftmost(points: FloatArray, poses: FloatArray, widths: FloatArray) -> FloatArray:
        return np.clip(0.5 - 2.0 * poses[:, 0, 3], 0.0, 1.0)

    plan = CurvaturePlanner(rerank=leftmost).plan(cloud, up=UP, table=TABLE)
    assert plan.best is not None
    assert plan.best.pose[0, 3] == min(grasp.pose[0, 3] for grasp in plain.candidates)
    assert sorted(grasp.terms["geometry"] for grasp in plan.candidates) == sorted(
        each.score for each in plain.candidates
    )
    assert plan.best.score == pytest.approx(0.5 - 2.0 * plan.best.pose[0, 3])


def test_what_makes_no_sense_is_refused() -> None:
    cloud = box_top(0.16, 0.04, 0.03)
    with pytest.raises(ConfigError, match="n_samples = 0"):
        LearnedPlanner(scores=level, n_samples=0)
    with pytest.raises(ConfigError, match="scores = None"):
        LearnedPlanner(scores=None)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="scores: said"):
        LearnedPlanner(scores=lambda cloud, poses, widths: widths * np.nan).plan(cloud, up=UP, table=TABLE)
    with pytest.raises(ConfigError, match="propose: gave an array of shape"):
        LearnedPlanner(scores=level, propose=lambda cloud: np.eye(4)).plan(cloud, up=UP)
    with pytest.raises(CloudError):
        LearnedPlanner(scores=level).plan(cloud[:5], up=UP)
