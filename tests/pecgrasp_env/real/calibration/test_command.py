"""`pecgrasp calibrate`: what its words mean, what it prints and leaves, and how it refuses."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from board_views import BOARD, CAMERA, HAS_HAND_EYE, board_views, error_of

from pecgrasp.cli import main
from pecgrasp.commands.calibrate import with_names
from pecgrasp_env.real.calibration.recorded_views import write_views
from pecgrasp_env.robot.camera_mount import read_mount


def run(*words: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["pecgrasp", "calibrate", *words])
        main()


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["board", "paper=A3"], ["action=board", "paper=A3"]),
        (["my views"], ['views="my views"']),
        (["check", "f", "mount=a.yaml"], ["action=check", 'views="f"', "mount=a.yaml"]),
        (["views=x"], ["views=x"]),
        (["--help"], ["--help"]),
    ],
)
def test_the_first_words_name_the_action_and_the_folder(words, meant):
    assert with_names(words) == meant


@pytest.mark.skipif(not HAS_HAND_EYE, reason="pip install '.[calibrate]'")
def test_board_and_calibration_from_the_shell(tmp_path: Path, capsys):
    run("board", "board.columns=6", f"output={tmp_path}/sheet")
    assert {each.name for each in (tmp_path / "sheet").iterdir()} == {"board.pdf", "board.svg", "board.png"}
    write_views(tmp_path / "views", CAMERA, list(board_views(20, 1))[:8])
    run(str(tmp_path / "views"), f"output={tmp_path}/out")
    shown = capsys.readouterr().out
    assert all(name in shown for name in ("least squares", "tsai", "park", "horaud", "andreff", "daniilidis"))
    assert "to mend: 8 views: 15 to 20 average more of the noise away" in shown
    off, turned = error_of(read_mount(tmp_path / "out/T_tool0_camera.yaml"))
    assert off < 2e-3
    assert np.degrees(turned) < 0.3
    assert json.loads((tmp_path / "out/results.json").read_text())["views"][0]["corners"] == BOARD.n_corners


@pytest.mark.parametrize(
    ("words", "refusal"),
    [
        (["nowhere"], r"nowhere: there is no camera.yaml"),
        (["board", "board.square=35"], r"board.square=35: the side of a square in metres"),
        (["board", "+board.colour=red"], r"colour"),
        (["action=dance", "views=x"], r"action=dance: one of board, record, hand_eye, check"),
        (["record", "x"], r"host=… must be given"),
        (["check", "x", "parent=base"], r"mount=FILE must be given with parent=base"),
        (["check", "x", "mount=none.yaml"], r"none.yaml: No such file"),
        ([], r"Missing mandatory value: views"),
    ],
)
def test_refusals_are_one_line(words, refusal, tmp_path: Path):
    with pytest.raises(SystemExit, match=f"pecgrasp calibrate: .*{refusal}"):
        run(*words, f"output={tmp_path}")
