"""The flange of a stand-in's arm, read over real sockets by Universal Robots' own protocol."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("rtde_receive", reason="pip install '.[ur]'")

from pecgrasp_env.real.calibration.ur_flange import ur_flange
from pecgrasp_env.real.errors import ConnectionLost
from pecgrasp_env.real.ur_models import UR5
from pecgrasp_env.robot.kinematics import HOME, forward_kinematics

# In a process of its own: the client library holds Python's lock while it connects.
SERVE = """
import sys
from pecgrasp_env.real.fakes.fake_robot import FakeRobot
from pecgrasp_env.real.fakes.plant import FollowingJoints
robot = FakeRobot(FollowingJoints(), sys.argv[1])
print("listening", flush=True)
robot.run()
"""


def test_the_flange_is_where_the_joints_put_it(host):
    with subprocess.Popen([sys.executable, "-c", SERVE, host], stdout=subprocess.PIPE, text=True) as robot:
        try:
            assert robot.stdout is not None
            assert robot.stdout.readline() == "listening\n"
            np.testing.assert_allclose(ur_flange(host, UR5)(), forward_kinematics(HOME), atol=1e-6)
        finally:
            robot.kill()


def test_an_address_where_no_controller_is_is_named(host):
    with pytest.raises(ConnectionLost, match=f"host={host}: .*is this its address"):
        ur_flange(host, UR5)
