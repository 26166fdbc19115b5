"""Each fault in mid-pick: the arm stands, the error is the documented one, and nothing moves until it is mended."""

import time

import numpy as np
import pytest

pytest.importorskip("rtde_control", reason="pip install 'pecgrasp[ur]'")

from pecgrasp_env.policy.scripted import ScriptedPolicy
from pecgrasp_env.real import ConnectionLost, EmergencyStop, GripperFault, NotInRemoteControl, ProtectiveStop
from pecgrasp_env.real.fakes.fake_robot import FAULTS
from pecgrasp_env.real.pick import STEP_S, NoRecord, Picker
from pecgrasp_env.real.robotiq import RobotiqGripper
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.real.workspace import Workspace
from pecgrasp_env.robot.kinematics import HOME

REST_S = 0.2  # simulated, from a fault to the arm's standing still
NOTICED_S = 0.15  # that a gripper takes to say that its fingers do not move
WAIT_S = 60
AWAY = HOME + 1.2 * np.eye(6)[0]
ERRORS = {
    "protective_stop": (ProtectiveStop, "look what it touches"),
    "emergency_stop": (EmergencyStop, "the emergency stop is pressed"),
    "connection_silent": (ConnectionLost, "has said nothing for 3.0 s|timed out; check the cable"),
    "connection_closed": (ConnectionLost, "closed the connection"),
    "program_stopped": (NotInRemoteControl, "its program was stopped"),
    "local_mode": (NotInRemoteControl, "local mode|its program was stopped"),
    "gripper_reset": (GripperFault, "is not activated"),
    "gripper_fault": (GripperFault, "fault 8, it is too hot"),
    "gripper_stuck": (GripperFault, "fault 14, too much current"),
}
IN_TEST_UR = {"lag", "cut", "none"}  # which change nothing
IN_TEST_PICK = {"object_lost", "objects_swapped"}  # which the policy mends


class Provokes(NoRecord):
    """A fault at the n-th step."""

    def __init__(self, bench, fault, n):
        self._bench, self._fault, self._left = bench, fault, n

    def step(self, observation, action, doing):
        self._left -= 1
        if self._left == 0:
            self._bench.provoke(self._fault)


class NoCamera:
    """The way to the first view needs none."""

    def grab(self):
        raise AssertionError("the arm came to where it looks")

    def close(self): ...


@pytest.fixture(scope="module")
def bench(hosts, fake_robot):
    host = hosts()
    with fake_robot(host, "scene=joints", "robot.series=e-Series") as bench:
        bench.host = host
        yield bench


@pytest.mark.parametrize("fault", ERRORS)
def test_it_ends_with_its_error_and_the_arm_stands(bench, fault):
    bench.ask(reset=0)
    arm, gripper = URArm(bench.host, patience=3.0), RobotiqGripper(bench.host)
    try:
        arm.move_joints(AWAY).wait(WAIT_S)
        gripper.move(0.0, 0.25, 40.0).wait(WAIT_S)  # so that the fingers move, too
        policy = ScriptedPolicy(None, control_dt=STEP_S)
        picker = Picker(arm, gripper, NoCamera(), policy, Workspace(), speed=1.0, record=Provokes(bench, fault, 4))
        outcome = picker.pick("can")
        error, words = ERRORS[fault]
        assert isinstance(outcome.error, error)
        with pytest.raises(error, match=words):
            raise outcome.error
        assert not outcome.lifted
        deadline = time.monotonic() + WAIT_S
        while (state := bench.state)["at_rest_since"] is None:
            assert time.monotonic() < deadline
        within = REST_S + NOTICED_S * (fault == "gripper_stuck")

        assert state["at_rest_since"] - state["fault_at"] < within
        assert np.abs(np.array(state["q"]) - HOME).max() > 0.1  # on the way
        bench.provoke("none")
        assert bench.state["q"] == pytest.approx(state["q"], abs=1e-3)
    finally:
        gripper.close()
        arm.close()


def test_every_fault_that_the_stand_in_knows_is_tried():
    assert set(FAULTS) == {*ERRORS, *IN_TEST_UR, *IN_TEST_PICK}
