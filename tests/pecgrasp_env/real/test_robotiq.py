"""The gripper's driver and its stand-in, through a real socket."""

import threading
import time
from contextlib import contextmanager

import pytest

from pecgrasp_env.real import ConnectionLost, GripperFault, MotionTimeout, ParallelGripper, RobotiqGripper, SpeedLimit
from pecgrasp_env.real.fakes.network import Network
from pecgrasp_env.real.fakes.plant import FollowingJoints
from pecgrasp_env.real.fakes.robotiq_server import CLOSED_POSITION, OPEN_POSITION, FakeRobotiq, RobotiqConnection
from pecgrasp_env.real.robotiq import opening_of, position_of
from pecgrasp_env.robot.gripper_linkage import STROKE

PORT = 63352
WAIT_S = 60
_RESOLUTION = 0.0004  # m: half of a step of the position register


class Bench:
    """A gripper with fingers, its URCap, and the cable between them and us."""

    def __init__(self, host, active):
        self.network, self.gripper, self.fingers = Network(host), FakeRobotiq(active), FollowingJoints(0.004)
        self.network.listen(PORT, lambda network, client: RobotiqConnection(network, client, self.gripper))
        self.ended = False

    def run(self):
        due = time.monotonic()
        while not self.ended:
            due = max(due + self.fingers.period, time.monotonic())
            self.network.serve(due)
            self.fingers.step(self.fingers.q, self.gripper.opening, self.gripper.force)
            self.gripper.step(self.fingers.opening, self.fingers.period)
        self.network.close()


@contextmanager
def bench_at(host, active=True):
    bench = Bench(host, active)
    thread = threading.Thread(target=bench.run)
    thread.start()
    try:
        yield bench
    finally:
        bench.ended = True
        thread.join()


@pytest.fixture
def bench(host):
    with bench_at(host) as bench:
        yield bench


@pytest.fixture
def gripper(bench, host):
    gripper = RobotiqGripper(host)
    yield gripper
    gripper.close()


def test_it_goes_where_it_is_sent(gripper):
    assert isinstance(gripper, ParallelGripper)
    for width in (0.05, 0.0, 0.14):
        gripper.move(width, speed=0.25, force=20).wait(WAIT_S)
        assert gripper.width == pytest.approx(width, abs=_RESOLUTION)
        assert not gripper.is_holding


def test_it_holds_what_is_between_the_fingers_and_lets_go(gripper, bench):
    bench.fingers.between = 0.048
    gripper.move(0.0, speed=0.25, force=40).wait(WAIT_S)
    assert gripper.is_holding
    assert gripper.width == pytest.approx(0.048, abs=_RESOLUTION)
    assert bench.gripper.force == pytest.approx(40, abs=0.5)
    gripper.move(0.1, speed=0.25, force=40).wait(WAIT_S)
    assert not gripper.is_holding
    assert gripper.width == pytest.approx(0.1, abs=_RESOLUTION)


def test_a_late_and_broken_up_answer_is_the_same_answer(gripper, bench):
    bench.network.lag, bench.network.cut = 0.03, True
    gripper.move(0.06, speed=0.25, force=20).wait(WAIT_S)
    assert gripper.width == pytest.approx(0.06, abs=_RESOLUTION)


def test_it_must_be_activated_first(host):
    with bench_at(host, active=False):
        gripper = RobotiqGripper(host)
        with pytest.raises(GripperFault, match=r"not activated: activate\(\)"):
            gripper.move(0.05, speed=0.1, force=20)
        gripper.activate(WAIT_S)
        gripper.move(0.05, speed=0.25, force=20).wait(WAIT_S)
        gripper.close()


def test_a_stuck_finger_is_told_and_activation_mends_it(gripper, bench):
    bench.gripper.stuck = True
    motion = gripper.move(0.05, speed=0.25, force=20)
    with pytest.raises(GripperFault, match="fault 14, too much current"):
        motion.wait(WAIT_S)
    with pytest.raises(GripperFault, match="fault 14"):
        gripper.move(0.05, speed=0.25, force=20)
    bench.gripper.stuck = False
    gripper.activate(WAIT_S)
    gripper.move(0.05, speed=0.25, force=20).wait(WAIT_S)


def test_a_reset_while_it_moves_is_told(gripper, bench):
    motion = gripper.move(0.0, speed=0.03, force=20)
    bench.gripper.write({"ACT": 0})
    with pytest.raises(GripperFault, match="not activated"):
        motion.wait(WAIT_S)


def test_one_may_stop_waiting_and_cancel(gripper):
    motion = gripper.move(0.0, speed=0.03, force=20)
    with pytest.raises(MotionTimeout, match="still on their way"):
        motion.wait(0.1)
    motion.cancel()
    width = gripper.width
    assert width > 0.1
    time.sleep(0.2)
    assert gripper.width == width


def test_a_pulled_cable_and_a_closed_door_are_told(gripper, bench, host):
    bench.network.silent = True
    with pytest.raises(ConnectionLost, match="check the cable"):
        _ = gripper.width
    with pytest.raises(ConnectionLost, match="Robotiq URCap"):
        RobotiqGripper(host, PORT + 1)


def test_what_it_cannot_do_is_not_sent(gripper):
    for wish, name in (((0.05, 0.5, 20), "speed"), ((0.05, 0.1, 200), "force"), ((0.2, 0.1, 20), "width")):
        with pytest.raises(SpeedLimit, match=f"{name}="):
            gripper.move(*wish)
    assert gripper.width == pytest.approx(STROKE, abs=_RESOLUTION)


def test_calibration_finds_the_ends_of_the_register(host):
    with bench_at(host):
        gripper = RobotiqGripper(host, open_position=0, closed_position=255)
        gripper.calibrate(WAIT_S)
        assert gripper.open_position == pytest.approx(OPEN_POSITION, abs=1)
        assert gripper.closed_position == pytest.approx(CLOSED_POSITION, abs=1)
        gripper.close()


def test_register_and_opening_are_each_others_inverse():
    for position in range(OPEN_POSITION, CLOSED_POSITION + 1):
        opening = opening_of(position, OPEN_POSITION, CLOSED_POSITION)
        assert position_of(opening, OPEN_POSITION, CLOSED_POSITION) == position
