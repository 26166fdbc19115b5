"""The way of a pick: the policy, the drivers with their own client library, real sockets, and the simulated scene."""

import json
import sys
import time

import numpy as np
import pytest

pytest.importorskip("rtde_control", reason="pip install 'pecgrasp[ur]'")

from pecgrasp.cli import main
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.policy.viewpoints import look_at
from pecgrasp_env.real import Declined, ProtectiveStop, RobotiqGripper
from pecgrasp_env.real.fakes.bench import BenchCamera
from pecgrasp_env.real.pick import STEP_S, NoRecord, Picker
from pecgrasp_env.real.pick_record import recorded_frames
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.real.workspace import OutsideWorkspace, Workspace
from pecgrasp_env.robot.camera_mount import write_mount
from pecgrasp_env.robot.kinematics import HOME

PATIENCE_S = 60.0
REST_S = 0.2
TARGET = "plug_adapter"


@pytest.fixture
def bench(scene_bench):
    return scene_bench


class Interrupts(NoRecord):
    """Does something in mid-move: at the n-th step of what is being done."""

    def __init__(self, doing, n, act):
        self._left, self._doing, self._act = n, doing, act

    def step(self, observation, action, doing):
        self._left -= doing == self._doing
        if self._left == 0:
            self._left = -1
            self._act()


@pytest.fixture
def picker(bench):
    bench.ask(reset=1)
    arm, gripper, camera = URArm(bench.host, patience=PATIENCE_S), RobotiqGripper(bench.host), BenchCamera(bench.host)

    def make(**kwargs):
        policy = kwargs.pop("policy", ScriptedPolicy(None, control_dt=STEP_S))
        workspace = kwargs.pop("workspace", Workspace())
        return Picker(arm, gripper, camera, policy, workspace, speed=1.0, **kwargs)

    yield make
    for each in (arm, gripper, camera):
        each.close()


def run(command, *overrides):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["pecgrasp", command, *overrides])
        main()


def test_the_commands_look_pick_and_plan_again(bench, tmp_path, capsys):
    """As a user gives them; the scene's own judge says whether the object is up."""
    bench.ask(reset=1)
    common = [f"host={bench.host}", f"target={TARGET}", "checkpoint=null", f"patience={PATIENCE_S}"]
    common += ["camera=simulated", "speed=1.0"]
    run("pick", *common, f"output={tmp_path}/look")
    assert "dry_run=false moves" in capsys.readouterr().out
    assert bench.state["q"] == pytest.approx(HOME, abs=0.03)
    looked = json.loads((tmp_path / "look" / "decisions.jsonl").read_text())
    assert looked["chosen"] == 0
    assert looked["objects"][0]["place"][:2] == pytest.approx(bench.state["places"][0][:2], abs=0.02)

    run("pick", *common, f"output={tmp_path}/pick", "dry_run=false", "confirm=no")
    outcome = json.loads((tmp_path / "pick" / "outcome.json").read_text())
    assert outcome["lifted"]
    assert outcome["error"] is None
    deadline = time.monotonic() + PATIENCE_S
    while bench.state["outcome"] is None:
        assert time.monotonic() < deadline
    assert bench.state["outcome"] == "success"

    run("replay-pick", f"folder={tmp_path}/look")
    replayed = json.loads((tmp_path / "look" / "replayed.json").read_text())
    assert replayed == [looked]


def test_a_camera_beside_the_robot_picks_as_well(bench, tmp_path):
    """It sees the table once the arm is out of its sight; its place comes from a file of `pecgrasp calibrate`."""
    bench.ask(reset=1)
    T = look_at((0.95, 0.0, 0.75), (0.5, 0.0, 0.0))
    T[:3, :2] *= -1  # upright from the other side of the table
    write_mount(tmp_path / "T_base_camera.yaml", "base", T, {})
    place = f"{tmp_path}/T_base_camera.yaml"
    settings = [f"host={bench.host}", f"target={TARGET}", "checkpoint=null", f"patience={PATIENCE_S}", "speed=1.0"]
    settings += ["camera=simulated", f"camera.beside={place}", f"calibration={place}", "dry_run=false", "confirm=no"]
    run("pick", *settings, f"output={tmp_path}/pick")
    assert json.loads((tmp_path / "pick" / "outcome.json").read_text())["lifted"]
    frames = list(recorded_frames(tmp_path / "pick"))
    assert all(frame["T_base_camera"] == pytest.approx(T) for frame in frames)
    assert abs(frames[0]["q"][0] - HOME[0]) > 1.0


def test_a_protective_stop_in_mid_move_ends_the_pick(picker, bench):
    record = Interrupts("moving over the object", 8, lambda: bench.provoke("protective_stop"))
    outcome = picker(record=record).pick(TARGET)
    assert isinstance(outcome.error, ProtectiveStop)
    assert not outcome.lifted
    deadline = time.monotonic() + PATIENCE_S
    while (state := bench.state)["at_rest_since"] is None:
        assert time.monotonic() < deadline
    assert state["at_rest_since"] - state["fault_at"] < REST_S


@pytest.fixture
def pair_bench(hosts, fake_robot):
    """A joypad and a mouse lie there."""
    host = hosts()
    scene = ["env.n_objects=2", "env.classes=[joypad,mouse]", "env.objects.seed=0", "env.objects.instances_per_class=2"]
    with fake_robot(host, *scene, "seed=2", "pace=8") as bench:
        bench.host = host
        yield bench


def by_length(cloud):
    """A joypad is longer than a mouse."""
    away = cloud - cloud.mean(axis=0)
    along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
    return ("joypad" if np.ptp(along) > 0.125 else "mouse"), 0.99


def pick_while_swapped(bench, target, policy):
    """A new episode in which somebody reaches in while the hand is on its way."""
    bench.ask(reset=2)
    arm, gripper, camera = URArm(bench.host, patience=PATIENCE_S), RobotiqGripper(bench.host), BenchCamera(bench.host)
    swaps = Interrupts("moving over the object", 3, lambda: bench.provoke("objects_swapped"))
    try:
        return Picker(arm, gripper, camera, policy, Workspace(), speed=1.0, record=swaps).pick(target)
    finally:
        for each in (arm, gripper, camera):
            each.close()


@pytest.mark.slow
def test_another_thing_put_where_the_asked_for_one_lay_is_put_back(pair_bench):
    """The joypad is as wide across as the mouse: only a look at the table says that the hand holds another thing."""
    target, words = "mouse", "holds something else: the mouse lies where another thing was"
    policy = ScriptedPolicy(by_length, control_dt=STEP_S)
    outcome = pick_while_swapped(pair_bench, target, policy)
    assert policy.log.failures == [words]
    assert (outcome.lifted, outcome.error) == (True, None)
    heights = {name: place[2] for name, place in zip(*map(pair_bench.state.get, ("classes", "places")), strict=True)}
    assert heights["mouse"] > 0.15
    assert heights["joypad"] < 0.05

    outcome = pick_while_swapped(pair_bench, target, ScriptedPolicy(by_length, control_dt=STEP_S, attempts=1))
    assert (outcome.lifted, outcome.error, outcome.reason) == (False, None, words)
    deadline = time.monotonic() + PATIENCE_S
    while (state := pair_bench.state)["at_rest_since"] is None:
        assert time.monotonic() < deadline
    assert max(place[2] for place in state["places"]) < 0.05


def test_one_thing_alone_cannot_be_swapped(bench):
    with pytest.raises(ValueError, match=r"nothing but the plug_adapter lies there: env\.n_objects=2 or more"):
        bench.provoke("objects_swapped")


@pytest.mark.slow
def test_what_slips_out_while_it_is_lifted_is_noticed_and_picked_up_again(picker, bench):
    policy = ScriptedPolicy(None, control_dt=STEP_S)
    record = Interrupts("lifting", 15, lambda: bench.provoke("object_lost"))
    outcome = picker(policy=policy, record=record).pick(TARGET)
    assert policy.log.failures == ["lost while lifting"]
    assert outcome.lifted
    assert outcome.error is None


def test_the_user_may_say_no_and_the_workspace_does(picker, bench):
    asked = []
    outcome = picker(ask=lambda doing: bool(asked.append(doing))).pick(TARGET)
    assert isinstance(outcome.error, Declined)
    assert asked == ["looking, view 1"]
    stood = np.array(bench.state["q"])
    outcome = picker(workspace=Workspace(low=(0.6, -0.6, 0.0))).pick(TARGET)
    assert isinstance(outcome.error, OutsideWorkspace)
    assert "would be at x" in str(outcome.error)
    assert bench.state["q"] == pytest.approx(stood, abs=0.005)


def test_the_arm_looks_around_a_thing_and_learns_it(bench, checkpoint, tmp_path):
    """Nothing is touched, and each frame is kept with where the camera was."""
    bench.ask(reset=1)
    lay = bench.state["places"][0]
    settings = [f"host={bench.host}", f"checkpoint={checkpoint}", "camera=simulated", f"patience={PATIENCE_S}"]
    settings += ["name=my_plug", "count=6", "lays=1", "least=4", "speed=1.0", "confirm=no", f"output={tmp_path}/out"]
    run("teach", *settings)
    assert bench.state["places"][0] == pytest.approx(lay, abs=1e-3)
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["views"] >= 4
    assert results["classes"] == ["ball", "rod", "my_plug"]
    frames = list(recorded_frames(tmp_path / "out"))
    assert len(frames) == 6
    assert len({tuple(frame["T_base_camera"][:3, 3].round(2)) for frame in frames}) == 6
