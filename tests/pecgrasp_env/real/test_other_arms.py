"""Whole picks with other arms than the UR5, through real sockets, in kinematics.

The arm follows exactly, what its camera sees is computed, and its fingers stop at a can.
"""

import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("rtde_control", reason="pip install 'pecgrasp[ur]'")

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real import ConnectionLost, RobotiqGripper
from pecgrasp_env.real.errors import WrongArm
from pecgrasp_env.real.fakes.bench import Bench
from pecgrasp_env.real.pick import STEP_S, NoRecord, Picker
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.real.ur_models import UR5, URModel
from pecgrasp_env.real.workspace import Workspace
from pecgrasp_env.robot import arm_lengths
from pecgrasp_env.robot.kinematics import COUPLER, T_TOOL0_CAMERA, forward_kinematics
from tests.pecgrasp_env.real.drawn_table import table_with
from tests.pecgrasp_env.robot.known_arms import UR3, UR10E, measured

RADIUS, HEIGHT = 0.033, 0.09
PATIENCE_S = 60.0

# In a process of its own, which the client library's lock does not halt.
SERVE = """
import sys
import numpy as np
from pecgrasp_env.real.fakes.fake_robot import FakeRobot
from pecgrasp_env.real.fakes.plant import FollowingJoints
from pecgrasp_env.robot.arm_lengths import JOINT_LIMITS, ArmLengths
held = np.load(sys.argv[2])
arm = ArmLengths(held["dh"], JOINT_LIMITS, float(held["footprint"])).with_measured(held["measured"])
FakeRobot(FollowingJoints(between=float(held["between"]), arm=arm), sys.argv[1], active=True, pace=4).run()
"""


class Camera:
    """On the bracket of the true arm, over a table with a can that is there until it is lifted."""

    def __init__(self, bench, arm, place):
        self._bench, self._arm, self._can = bench, arm, (*place, RADIUS, HEIGHT)

    def grab(self):
        state = self._bench.state
        held = state["opening"] < 2 * RADIUS + 1e-3
        T = forward_kinematics(np.array(state["q"]), self._arm) @ T_TOOL0_CAMERA
        return table_with([] if held else [self._can], T)

    def close(self): ...


class Closings(NoRecord):
    """Where the arm was when the fingers had met the can."""

    q = None

    def step(self, observation, action, doing):
        if doing == "closing" and observation.opening < 2 * RADIUS + 1e-3 and self.q is None:
            self.q = observation.q


def stand_in(host, arm, file):
    table = np.column_stack([np.zeros(6), arm.dh]) if arm.measured is None else arm.measured
    np.savez(file, dh=arm.dh, footprint=arm.footprint, measured=table, between=2 * RADIUS)
    process = subprocess.Popen([sys.executable, "-c", SERVE, host, str(file)])
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return process, Bench(host)
        except ConnectionLost:
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)


def model_of(name, arm):
    return URModel(name, "CB3", arm.dh, arm.limits, np.full(6, 2.0), 3.0, arm.footprint)


@pytest.mark.parametrize(
    ("name", "arm", "place"),
    [
        ("UR3", UR3, (0.28, 0.0)),
        ("UR10e", UR10E, (0.55, -0.1)),
        ("UR5, measured", measured(arm_lengths.UR5, 0.7), (0.6, -0.1)),
    ],
)
def test_a_can_is_picked_where_it_stands(name, arm, place, host, tmp_path):
    process, bench = stand_in(host, arm, tmp_path / "arm.npz")
    try:
        robot, gripper = URArm(host, model_of(name, arm), patience=PATIENCE_S, speed=1.0), RobotiqGripper(host)
        closings = Closings()
        policy = ScriptedPolicy(None, control_dt=STEP_S, arm=robot.lengths)
        picker = Picker(robot, gripper, Camera(bench, arm, place), policy, Workspace(), speed=1.0, record=closings)
        outcome = picker.pick("can")
        assert outcome.error is None
        assert outcome.lifted, outcome.reason
        T = forward_kinematics(closings.q, arm)
        pads = T[:3, 3] + (COUPLER + float(ROBOTIQ_2F_140.pad_depth(2 * RADIUS))) * T[:3, 2]
        assert pads[:2] == pytest.approx(place, abs=2e-3)
        for each in (robot, gripper):
            each.close()
    finally:
        bench.ask(ask="stop")
        bench.close()
        assert process.wait(PATIENCE_S) == 0


def test_a_small_arm_that_was_taken_for_a_ur5_does_not_move(host, tmp_path):
    process, bench = stand_in(host, UR3, tmp_path / "arm.npz")
    try:
        with pytest.raises(WrongArm, match="robot=UR5"):
            URArm(host, UR5)
    finally:
        bench.ask(ask="stop")
        bench.close()
        process.wait(PATIENCE_S)
