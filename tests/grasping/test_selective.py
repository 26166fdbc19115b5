"""From a scene to a grasp on the object that was asked for; the classifier is a plain function."""

from dataclasses import dataclass

import numpy as np
import pytest
from grasping_shapes import UP, box_top, grid, moved

from grasping import ConfigError, CurvaturePlanner, SelectiveGrasper


def table_with(*objects: np.ndarray) -> np.ndarray:
    """A loose cloud in the world's frame, 0.5 m in front of its origin."""
    flat = grid((-0.4, 0.4), (-0.3, 0.3), step=0.003)
    table = np.column_stack([flat, np.zeros(len(flat))])
    return moved(np.vstack([table, *objects]), x=0.5)


SMALL = moved(box_top(0.06, 0.04, 0.03), x=-0.15)
LONG = moved(box_top(0.16, 0.03, 0.02), y=0.1)
HUGE = moved(box_top(0.20, 0.18, 0.05), x=0.2, y=-0.1)


def by_size(points: np.ndarray) -> tuple[str, float]:
    """Label by the longest side, as unlike a network as can be."""
    length = float(np.ptp(points[:, :2], axis=0).max())
    return ("small", 0.9) if length < 0.1 else ("long", 0.8) if length < 0.18 else ("huge", 0.7)


def grasper(**options: float) -> SelectiveGrasper:
    return SelectiveGrasper(by_size, CurvaturePlanner(max_tilt=0.0), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(("target", "place"), [("small", (0.35, 0.0)), ("long", (0.5, 0.1))])
def test_the_object_of_the_class_is_chosen_and_planned_on(target: str, place: tuple[float, float]) -> None:
    selection = grasper().select(table_with(SMALL, LONG, HUGE), target, up=UP)
    assert sorted(selection.labels) == ["huge", "long", "small"]
    assert selection.reason is None
    assert selection.chosen is not None
    assert selection.labels[selection.chosen] == target
    assert selection.plan is not None
    assert selection.plan.best is not None
    assert np.linalg.norm(selection.plan.best.pose[:2, 3] - place) < 0.03


def test_neighbours_are_obstacles() -> None:
    wall = moved(box_top(0.16, 0.05, 0.12), x=-0.15, y=0.065)
    selection = grasper().select(table_with(SMALL, wall), "small", up=UP)
    assert len(selection.scene.objects) == 2
    assert selection.plan is not None
    assert selection.plan.best is not None
    best = selection.plan.best
    local = (moved(wall, x=0.5) - best.pose[:3, 3]) @ best.pose[:3, :3]
    hit = (np.abs(local[:, 0]) < best.width / 2 + 0.018) & (np.abs(local[:, 1]) < 0.0135) & (local[:, 2] < 0.0325)
    assert not hit.any()
    assert abs(best.pose[0, 0]) > 0.9  # across the long side, as the wall leaves no room across the short one


def test_a_class_that_is_not_there_is_said_with_what_is() -> None:
    selection = grasper().select(table_with(SMALL, LONG), "mouse", up=UP)
    assert selection.chosen is None
    assert selection.plan is None
    assert "no mouse" in str(selection.reason)
    assert "small (0.90)" in str(selection.reason)


def test_an_unsure_answer_is_not_acted_on() -> None:
    selection = grasper(min_confidence=0.85).select(table_with(SMALL, LONG), "long", up=UP)
    assert selection.chosen is None
    assert "0.80" in str(selection.reason)


def test_an_object_that_cannot_be_grasped_says_why() -> None:
    selection = grasper().select(table_with(SMALL, HUGE), "huge", up=UP)
    assert selection.chosen is None
    assert selection.plan is not None
    assert selection.plan.reason is not None
    assert selection.plan.reason in str(selection.reason)


def test_an_empty_table_says_so() -> None:
    selection = grasper().select(table_with(), "small", up=UP)
    assert selection.chosen is None
    assert "no object" in str(selection.reason)


def test_the_likeliest_of_two_is_taken() -> None:
    def unsure_on_the_left(points: np.ndarray) -> tuple[str, float]:
        return "box", 0.5 if points[:, 0].mean() < 0.5 else 0.9

    other = moved(box_top(0.06, 0.04, 0.03), x=0.15)
    selection = SelectiveGrasper(unsure_on_the_left, CurvaturePlanner()).select(table_with(SMALL, other), "box", up=UP)
    assert selection.chosen is not None
    assert selection.scene.objects[selection.chosen][:, 0].mean() > 0.5


def test_a_confidence_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match="min_confidence"):
        grasper(min_confidence=1.5)


@dataclass
class Prediction:
    """What a classifier that knows strangers answers."""

    label: str
    confidence: float
    probabilities: dict[str, float]
    known: float


def test_a_sure_answer_needs_no_other_view_and_an_unsure_one_does() -> None:
    for known, doubt in ((0.99, None), (0.8, "whether it is a box is unsure (0.78)")):
        answer = Prediction("box", 0.98, {"box": 0.98, "can": 0.02}, known)
        selection = SelectiveGrasper(lambda _, given=answer: given, CurvaturePlanner()).select(
            table_with(SMALL), "box", up=UP
        )
        assert selection.chosen == 0
        assert selection.known == [known]
        assert selection.doubt == doubt
        assert not selection.absent


def test_a_stranger_is_not_touched_and_what_may_be_the_class_is_to_be_looked_at_again() -> None:
    for known, absent in ((0.02, True), (0.4, False)):
        answer = Prediction("unknown", 0.98, {"box": 0.98, "can": 0.02}, known)
        selection = SelectiveGrasper(lambda _, given=answer: given, CurvaturePlanner()).select(
            table_with(SMALL), "box", up=UP
        )
        assert selection.chosen is None
        assert selection.plan is None
        assert "no box" in str(selection.reason)
        assert selection.absent == absent
        assert (selection.doubt is None) == absent


def test_what_two_values_say_is_enough_to_call_a_class_absent() -> None:
    assert grasper().select(table_with(SMALL, LONG), "mouse", up=UP).absent
    assert not grasper().select(table_with(SMALL, LONG), "small", up=UP).absent
    assert grasper().select(table_with(), "small", up=UP).absent
