"""The stand-in's controller by itself, without sockets."""

import numpy as np
import pytest

from pecgrasp_env.real.fakes.controller import Controller, Program
from pecgrasp_env.real.fakes.plant import FollowingJoints
from pecgrasp_env.real.fakes.robotiq_server import FakeRobotiq
from pecgrasp_env.robot.kinematics import HOME


class Endless(Program):
    def step(self):
        return True


@pytest.mark.parametrize(("pace", "silence"), [(1.0, 0.25), (0.5, 0.25), (4.0, 1.0)])
def test_a_watchdog_waits_a_quarter_of_a_second_on_the_wall_however_fast_the_clock_is(pace, silence):
    controller = Controller(FollowingJoints(), FakeRobotiq(True), pace=pace)
    controller.start(Endless())
    controller.set_watchdog(4.0)
    heard = 0.5
    while controller.time < heard:
        controller.word_from_client(0)
        controller.tick()
    while controller.program is not None:
        controller.tick()
    assert controller.time - heard == pytest.approx(silence, abs=3 * controller.period)


def test_a_target_beyond_a_joint_limit_is_a_protective_stop_within_the_limit():
    controller = Controller(FollowingJoints(), FakeRobotiq(True))
    controller.start(Endless())
    controller.servo(HOME + np.array([0, 0, 5.0, 0, 0, 0]), 0.03)
    while not controller.protective:
        controller.tick()
    stopped = controller.time
    while np.abs(controller.measured_rates).max() > 0:
        controller.tick()
    assert controller.program is None
    assert controller.time - stopped < 0.2
    assert controller.measured[2] <= controller.plant.arm.limits[2, 1]
