"""Taking pictures with a hand that is moved about: what is kept, what is not and why, and what is lacking."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from board_views import BOARD, CAMERA, HAS_HAND_EYE, board_views, motion

from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.record_views import record_views
from pecgrasp_env.real.calibration.recorded_views import read_views

pytestmark = pytest.mark.skipif(not HAS_HAND_EYE, reason="pip install '.[calibrate]'")


class Hand:
    """Goes through views; at those in `unsteady` it moves while the picture is taken."""

    def __init__(self, views, unsteady=()):
        self.views, self.unsteady, self.at, self.asked = views, unsteady, -1, 0

    def go_on(self, words: str) -> bool:
        self.at += 1
        return self.at < len(self.views)

    def picture(self):
        return self.views[self.at].image, CAMERA

    def pose(self):
        self.asked += 1
        drift = 0.001 * self.asked if self.at in self.unsteady else 0.0
        return self.views[self.at].T_base_tool0 @ motion(drift, 0, 0, (0, 0, 0))


def test_pictures_at_rest_that_show_the_board_are_kept(tmp_path: Path):
    views = list(board_views(20, 1))[:6]
    views[2] = type(views[2])("", np.full((480, 848), 90, np.uint8), views[2].T_base_tool0)
    hand, said = Hand(views, unsteady={4}), []
    assert record_views(tmp_path / "views", BOARD, hand.picture, hand.pose, hand.go_on, said.append) == 4
    assert [words.split(":")[0] for words in said] == ["kept", "kept", "not kept", "kept", "not kept", "kept"]
    assert "no marker of the board is seen" in said[2]
    assert "still moved" in said[4]
    assert "4 views: 15 to 20 average more" in said[5]
    intrinsics, kept = read_views(tmp_path / "views")
    assert intrinsics.fx == CAMERA.fx
    for view, number in zip(kept, (0, 1, 3, 5), strict=True):
        np.testing.assert_allclose(view.T_base_tool0, views[number].T_base_tool0, atol=1e-8)
        assert (view.image == views[number].image).all()
    with pytest.raises(CalibrationError, match="holds views already"):
        record_views(tmp_path / "views", BOARD, hand.picture, hand.pose, hand.go_on, said.append)


def test_an_arm_that_swings_for_a_moment_is_waited_for(tmp_path: Path):
    class Swinging(Hand):
        def pose(self):
            self.asked += 1
            swing = 0.002 * 0.5**self.asked
            return self.views[self.at].T_base_tool0 @ motion(swing, 0, 0, (0, 0, 0))

    views, said = list(board_views(20, 1))[:1], []
    hand = Swinging(views)
    assert record_views(tmp_path / "views", BOARD, hand.picture, hand.pose, hand.go_on, said.append) == 1
    assert [words.split(":")[0] for words in said] == ["kept"]
    _, (kept,) = read_views(tmp_path / "views")
    np.testing.assert_allclose(kept.T_base_tool0, views[0].T_base_tool0, atol=2e-4)


def test_turns_about_one_axis_are_said_while_one_can_still_do_otherwise(tmp_path: Path):
    first = board_views(20, 1)[0]
    views = [type(first)("", first.image, first.T_base_tool0 @ motion(0, 0, 0, (0, 0, 20 * k))) for k in range(4)]
    hand, said = Hand(views), []
    record_views(tmp_path, BOARD, hand.picture, hand.pose, hand.go_on, said.append)
    assert "about one axis only, near its z" in said[3]
