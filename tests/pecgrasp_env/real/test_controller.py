"""The stand-in's controller by itself, without sockets."""

import pytest

from pecgrasp_env.real.fakes.controller import Controller, Program
from pecgrasp_env.real.fakes.plant import FollowingJoints
from pecgrasp_env.real.fakes.robotiq_server import FakeRobotiq


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
