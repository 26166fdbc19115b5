"""The lengths of one arm, as its controller tells them, over real sockets."""

import socket
import threading
from contextlib import contextmanager

import numpy as np
import pytest

from pecgrasp_env.real import ConnectionLost
from pecgrasp_env.real.errors import WrongArm
from pecgrasp_env.real.fakes.fake_robot import FakeRobot
from pecgrasp_env.real.fakes.plant import FollowingJoints
from pecgrasp_env.real.ur_measured import PORT, departure, lengths_of, words_of
from pecgrasp_env.real.ur_models import UR5
from pecgrasp_env.robot import arm_lengths
from pecgrasp_env.robot.kinematics import HOME, forward_kinematics
from tests.pecgrasp_env.robot.known_arms import UR10E, measured

MINE = measured(arm_lengths.UR5, 0.5)


@contextmanager
def served(host, arm):
    robot = FakeRobot(FollowingJoints(arm=arm), host)
    thread = threading.Thread(target=robot.run)
    thread.start()
    try:
        yield robot
    finally:
        robot.stop()
        thread.join()


@pytest.mark.parametrize("cut", [False, True])
def test_the_controller_tells_its_arms_lengths(host, cut):
    with served(host, MINE) as robot:
        robot.network.cut = cut
        arm = lengths_of(host, UR5)
    np.testing.assert_array_equal(arm.measured, MINE.measured)
    np.testing.assert_array_equal(arm.dh, arm_lengths.DH)
    np.testing.assert_array_equal(forward_kinematics(HOME, arm), forward_kinematics(HOME, MINE))
    away, turned = departure(arm)
    assert 1e-3 < away < 8e-3
    assert f"{1e3 * away:.1f} mm and {np.degrees(turned):.2f}°" in words_of(arm)


def test_an_uncorrected_arm_is_its_type(host):
    with served(host, arm_lengths.UR5):
        assert departure(lengths_of(host, UR5)) == pytest.approx((0, 0), abs=1e-12)


def test_an_old_controller_tells_none(host):
    with served(host, MINE) as robot:
        robot.controller.tells_lengths = False
        arm = lengths_of(host, UR5, patience=0.0)
    assert arm is UR5.lengths
    assert "those of its type" in words_of(arm)


def test_another_arm_than_was_said_is_refused(host):
    with served(host, UR10E), pytest.raises(WrongArm, match=r"robot=UR5: .*a2, a3.* = -0\.6127, -0\.5716, "):
        lengths_of(host, UR5)


def test_what_is_no_controller_is_said(host):
    with pytest.raises(ConnectionLost, match=f"host={host}: port {PORT}.*is this its address"):
        lengths_of(host, UR5)
    with socket.create_server((host, PORT)) as server:

        def greet():
            client, _ = server.accept()
            client.sendall(b"220 mail.example ready\r\n")
            client.close()

        thread = threading.Thread(target=greet)
        thread.start()
        with pytest.raises(ConnectionLost, match="is it a UR's controller"):
            lengths_of(host, UR5)
        thread.join()
