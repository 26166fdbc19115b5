"""The page of a pick and its live view, from a folder as a pick leaves it; no robot and no simulator."""

import json
import re
import sys
import urllib.request

import numpy as np
import pytest

from pecgrasp.cli import main
from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real.live_view import LiveView
from pecgrasp_env.real.pick_page import write_pick_page
from pecgrasp_env.real.pick_record import write_frame
from pecgrasp_env.robot.kinematics import HOME, T_TOOL0_CAMERA, forward_kinematics
from pecgrasp_env.sensor.intrinsics import intrinsics_of

CAMERA = intrinsics_of("424x240")
T_BASE_CAMERA = forward_kinematics(HOME) @ T_TOOL0_CAMERA


def depth_of_boxes(*boxes):
    """Of a table at z = 0 with boxes (x, y, half side, height), m, seen from straight above."""
    v, u = np.indices((CAMERA.height, CAMERA.width)) + 0.5
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1)
    rays, eye = rays @ T_BASE_CAMERA[:3, :3].T, T_BASE_CAMERA[:3, 3]
    depth = -eye[2] / rays[..., 2]
    for x, y, half, height in boxes:
        top = (height - eye[2]) / rays[..., 2]
        hit = eye + top[..., None] * rays
        depth = np.where((np.abs(hit[..., 0] - x) < half) & (np.abs(hit[..., 1] - y) < half), top, depth)
    return depth.astype(np.float32)


@pytest.fixture
def folder(tmp_path):
    """A pick that lifted something after one look."""
    (tmp_path / "frames").mkdir()
    frame = DepthFrame(depth_of_boxes((0.5, 0.0, 0.025, 0.05), (0.42, 0.14, 0.02, 0.03)), CAMERA)
    seen = RobotObservation(HOME, 0.14, lambda: frame, camera=T_BASE_CAMERA)
    write_frame(tmp_path / "frames" / "000.npz", seen, frame)
    (tmp_path / "settings.json").write_text(json.dumps({"target": "box", "checkpoint": None}))
    outcome = {"failures": [], "error": None, "lifted": True, "held_m": 0.05, "reason": None, "seconds": 6.0}
    (tmp_path / "outcome.json").write_text(json.dumps(outcome))
    steps = [
        {"doing": doing, "q": (HOME + 0.05 * k).tolist(), "opening": 0.14, "target": [0.0] * 8}
        for k, doing in enumerate(["looking, view 1"] * 3 + ["closing"] * 2)
    ]
    (tmp_path / "steps.jsonl").write_text("".join(json.dumps(step) + "\n" for step in steps))
    return tmp_path


def test_the_page_shows_each_frame_its_things_the_grasp_and_the_way(folder, outline):
    decisions = write_pick_page(folder, ScriptedPolicy(None), "box")
    assert len(decisions) == 1
    assert decisions[0]["chosen"] == 0
    assert decisions[0]["T_base_grasp"] is not None
    page = outline((folder / "pick.html").read_text())
    assert "It was lifted, 50 mm wide." in page.text
    assert "box 100 %" in page.text.replace("\N{NO-BREAK SPACE}", " ")
    assert "closing" in page.text
    figure, way = (json.loads(data) for data in page.data)
    assert [layer["legend"] for layer in figure["layers"] if layer["group"]][-1] == "the fingertips' way"
    assert len(figure["grasps"]) == 1
    assert [layer["legend"] for layer in way["layers"] if layer["group"]] == ["looking, view 1", "closing"]


def test_the_command_leaves_the_page_and_shows_it_live(folder, capsys, monkeypatch):
    pytest.importorskip("viser", reason="pip install 'pecgrasp[view]'")
    pages = []

    def look_at_it(words):
        pages.append(urllib.request.urlopen(re.search(r"http://[\d.:]+", words)[0], timeout=60).read())
        return ""

    monkeypatch.setattr("builtins.input", look_at_it)
    monkeypatch.setattr(sys, "argv", ["pecgrasp", "replay-pick", f"folder={folder}", "view=viser", "view_port=8971"])
    main()
    assert "live: http://127.0.0.1:" in capsys.readouterr().out
    assert b"<html" in pages[0]
    assert (folder / "replayed.html").exists()


def test_the_live_view_follows_a_policy():
    pytest.importorskip("viser", reason="pip install 'pecgrasp[view]'")
    policy = ScriptedPolicy(None)
    policy.reset("box")
    frame = DepthFrame(depth_of_boxes((0.5, 0.0, 0.025, 0.05)), CAMERA)
    view = LiveView(port=8973, of=policy)
    try:
        q, doings = HOME, []
        for _ in range(60):
            seen = RobotObservation(q, 0.14, lambda: frame, camera=T_BASE_CAMERA)
            action = policy.step(seen)
            view.frame(seen, frame)
            view.step(seen, action, policy.log.doing)
            doings.append(view.doing)
            q = action[:6].astype(float)
        assert doings[0] == "looking, view 1"
        assert "moving over the object" in doings
        assert policy.way is not None
    finally:
        view.close()


def test_without_viser_the_extra_is_named(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    monkeypatch.setattr(sys, "argv", ["pecgrasp", "replay-pick", f"folder={folder}", "view=viser"])
    with pytest.raises(SystemExit, match=r"pecgrasp\[view\]"):
        main()
