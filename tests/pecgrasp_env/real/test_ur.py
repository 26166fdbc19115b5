"""The arm's driver through ur_rtde and real sockets against the stand-in, which provokes each fault."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rtde_control", reason="pip install 'pecgrasp[ur]'")

from pecgrasp_env.motion.joint_path import straight_line
from pecgrasp_env.real import (
    Arm,
    ConnectionLost,
    EmergencyStop,
    JointLimit,
    MissingExtra,
    MotionTimeout,
    NotInRemoteControl,
    ProtectiveStop,
    SpeedLimit,
)
from pecgrasp_env.real.errors import library
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.robot.kinematics import HOME, forward_kinematics

REST_S = 0.2  # simulated, from a fault to the arm's standing still
WAIT_S = 60
BASE = np.eye(6)[0]  # the first joint turns
AWAY = HOME + 0.4 * BASE
_JOINTS = ["scene=joints"]


@pytest.fixture(scope="module")
def bench(hosts, fake_robot):
    host = hosts()
    with fake_robot(host, *_JOINTS) as bench:
        bench.host = host
        yield bench


@pytest.fixture
def arm(bench):
    bench.ask(reset=0)
    arm = URArm(bench.host, patience=4.0)  # a busy machine is no lost connection
    yield arm
    arm.close()


def rest(bench):
    """Seconds of the controller's clock from the fault to rest."""
    deadline = time.monotonic() + WAIT_S
    while (state := bench.state)["at_rest_since"] is None:
        assert time.monotonic() < deadline
    return state["at_rest_since"] - state["fault_at"]


def until_moving(arm):
    deadline = time.monotonic() + WAIT_S
    while np.abs(arm.state.qd).max() < 0.3:
        assert time.monotonic() < deadline


def test_it_goes_along_a_path_and_stands_at_its_end(arm, bench):
    assert isinstance(arm, Arm)
    assert arm.state.q == pytest.approx(HOME, abs=1e-9)
    arm.move_joints(np.stack([HOME + 0.1, AWAY])).wait(WAIT_S)
    assert arm.state.q == pytest.approx(AWAY, abs=2e-3)
    assert bench.state["q"] == pytest.approx(arm.state.q, abs=2e-3)


def test_a_line_is_a_line(arm):
    T = forward_kinematics(arm.state.q)
    up = T.copy()
    up[2, 3] += 0.08
    motion = arm.move_linear(up)
    off = []
    while not motion.done:
        off.append(float(np.linalg.norm(forward_kinematics(arm.state.q)[:2, 3] - T[:2, 3])))
    motion.wait(WAIT_S)
    assert forward_kinematics(arm.state.q)[:3, 3] == pytest.approx(up[:3, 3], abs=1.5e-3)
    assert max(off) < 1.5e-3
    assert len(straight_line(HOME, T, up)) > 2


def test_followed_targets_do_not_halt_in_between(arm):
    rates = []
    for k in range(1, 21):
        arm.follow(HOME + 0.02 * k * BASE, 0.05).wait(WAIT_S)
        rates.append(arm.state.qd[0])
    assert arm.state.q[0] - HOME[0] == pytest.approx(0.4, abs=0.03)
    assert min(rates[5:]) > 0.05


def test_what_is_too_fast_takes_longer(arm):
    begun = arm.state.time
    arm.follow(AWAY, 0.05).wait(WAIT_S)
    assert arm.state.time - begun >= 0.4 / arm.speed


def test_one_may_stop_waiting_and_cancel(arm):
    motion = arm.move_joints(HOME + BASE)
    until_moving(arm)
    with pytest.raises(MotionTimeout, match="still on its way"):
        motion.wait(0.01)
    motion.cancel()
    assert motion.done
    assert arm.state.q[0] < HOME[0] + 0.99
    assert np.abs(arm.state.qd).max() < 0.02
    arm.move_joints(HOME).wait(WAIT_S)
    assert arm.state.q == pytest.approx(HOME, abs=2e-3)


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        ("protective_stop", ProtectiveStop),
        ("emergency_stop", EmergencyStop),
        ("program_stopped", NotInRemoteControl),
        ("connection_closed", ConnectionLost),
        ("connection_silent", ConnectionLost),
    ],
)
def test_a_fault_in_mid_move_ends_it_and_nothing_moves_until_one_says_so(arm, bench, fault, error):
    motion = arm.move_joints(HOME + 2 * BASE)
    until_moving(arm)
    bench.provoke(fault)
    with pytest.raises(error, match=f"UR5 at {bench.host}"):
        motion.wait(WAIT_S)
    assert rest(bench) < REST_S
    with pytest.raises(error):
        arm.move_joints(HOME)
    if error is not ConnectionLost:
        assert arm.state.q == pytest.approx(bench.state["q"], abs=0.02)
    stood = bench.state["q"]
    bench.provoke("none")
    assert bench.state["q"] == pytest.approx(stood, abs=1e-3)
    arm.recover()
    assert bench.state["q"] == pytest.approx(stood, abs=1e-3)
    arm.move_joints(HOME).wait(WAIT_S)
    assert arm.state.q == pytest.approx(HOME, abs=2e-3)


def test_what_still_stands_against_it_is_told_by_recover(arm, bench):
    bench.provoke("emergency_stop")
    deadline = time.monotonic() + WAIT_S
    while arm.error is None:
        assert time.monotonic() < deadline
    with pytest.raises(EmergencyStop, match="release the button"):
        arm.recover()
    bench.provoke("none")
    arm.recover()


def test_late_and_broken_up_packets_change_nothing(arm, bench):
    bench.provoke("lag")
    bench.provoke("cut")
    arm.move_joints(AWAY).wait(WAIT_S)
    bench.provoke("none")
    assert arm.state.q == pytest.approx(AWAY, abs=5e-3)


def test_what_the_arm_cannot_do_is_not_sent(arm, bench):
    with pytest.raises(JointLimit, match=r"joint 3 to 3\.500 rad: UR5 goes -3\.142 … 3\.142"):
        arm.move_joints(np.stack([AWAY, [0, 0, 3.5, 0, 0, 0]]))
    with pytest.raises(JointLimit, match="finite"):
        arm.follow(np.full(6, np.nan), 0.05)
    with pytest.raises(SpeedLimit, match="speed=7"):
        URArm(bench.host, speed=7)
    with pytest.raises(SpeedLimit, match="payload=9"):
        URArm(bench.host, payload=(9.0, (0, 0, 0.1)))
    assert bench.state["q"] == pytest.approx(HOME, abs=1e-9)


def test_the_arm_stops_when_the_process_that_leads_it_is_killed(arm, bench):
    motion = arm.move_joints(HOME + 2 * BASE)
    until_moving(arm)
    before = bench.state["time"]
    arm._process.send_signal(signal.SIGKILL)
    with pytest.raises(ConnectionLost, match=r"has died; recover\(\)"):
        motion.wait(WAIT_S)
    deadline = time.monotonic() + WAIT_S
    while (state := bench.state)["program"] or state["at_rest_since"] is None:  # the watchdog ends the program
        assert time.monotonic() < deadline
    assert state["at_rest_since"] - before < REST_S
    arm.recover()


_CLIENT = """
import sys
from pecgrasp_env.real.ur import URArm
arm = URArm(sys.argv[1])
arm.move_joints(arm.state.q + [3.0, 0, 0, 0, 0, 0])
print(arm._process.pid, flush=True)
input()
"""


def test_the_arm_stops_when_the_users_program_is_killed(bench):
    bench.ask(reset=0)
    client = subprocess.Popen(
        [sys.executable, "-c", _CLIENT, bench.host], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert int(client.stdout.readline()) > 0
    deadline = time.monotonic() + WAIT_S
    while bench.state["at_rest_since"] is not None:
        assert time.monotonic() < deadline
    before = bench.state["time"]
    client.kill()
    client.communicate()
    while (state := bench.state)["at_rest_since"] is None or state["clients"]:
        assert time.monotonic() < deadline
    assert state["at_rest_since"] - before < REST_S
    assert state["q"][0] < HOME[0] + 2.9


def test_no_process_is_left_behind_where_program_and_cable_are_gone(bench):
    bench.ask(reset=0)
    client = subprocess.Popen(
        [sys.executable, "-c", _CLIENT, bench.host], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    leader = Path(f"/proc/{int(client.stdout.readline())}")
    bench.provoke("connection_silent")
    client.kill()
    client.communicate()
    deadline = time.monotonic() + WAIT_S
    while leader.exists():
        assert time.monotonic() < deadline
        time.sleep(0.05)
    bench.provoke("none")


def test_no_socket_is_left_behind(bench):
    bench.ask(reset=0)
    for _ in range(2):
        URArm(bench.host).close()
        deadline = time.monotonic() + WAIT_S
        while bench.state["clients"]:
            assert time.monotonic() < deadline


def test_an_arm_in_local_mode_or_at_no_address_is_told(hosts, fake_robot):
    host = hosts()
    with fake_robot(host, *_JOINTS, "robot.series=e-Series") as bench:
        bench.provoke("local_mode")
        with pytest.raises(NotInRemoteControl, match="local mode: switch to Remote"):
            URArm(host)
        bench.provoke("none")
        arm = URArm(host)
        arm.move_joints(AWAY).wait(WAIT_S)
        assert arm.state.q == pytest.approx(AWAY, abs=2e-3)
        arm.close()
    with pytest.raises(ConnectionLost, match="is it on, and is this its address"):
        URArm(host)


def test_a_missing_library_names_what_brings_it():
    with pytest.raises(MissingExtra, match=r"pip install 'pecgrasp\[ur\]'"):
        library("a_module_that_nobody_has", "ur")
