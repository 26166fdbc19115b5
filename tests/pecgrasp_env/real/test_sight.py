"""What arm, gripper and camera say at one moment."""

import gc
import weakref
from types import SimpleNamespace

import numpy as np
import pytest

from pecgrasp_env.real.interfaces import ArmState, DepthImage
from pecgrasp_env.real.sight import Sight
from pecgrasp_env.robot.arm_lengths import UR5
from pecgrasp_env.robot.kinematics import HOME
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

INTRINSICS = CameraIntrinsics(4, 3, 5.0, 5.0, 2.0, 1.5)


class Camera:
    """Counts the frames that are taken: the k-th one is k metres away."""

    taken = 0

    def grab(self):
        self.taken += 1
        return DepthImage(np.full((3, 4), self.taken, np.float32), INTRINSICS, float(self.taken))

    def close(self): ...


@pytest.fixture
def camera():
    return Camera()


@pytest.fixture
def look(camera):
    arm = SimpleNamespace(state=ArmState(np.array(HOME), np.zeros(6), 0.0), lengths=UR5)
    seen = []
    sight = Sight(arm, SimpleNamespace(width=0.05), camera, seen=lambda *each: seen.append(each))
    sight.seen = seen
    return sight


def test_a_frame_is_taken_once_when_it_is_looked_at_and_told_with_its_moment(look, camera):
    observation = look.observe()
    assert camera.taken == 0
    assert observation.frame.depth.max() == 1
    assert observation.frame.depth.max() == 1
    ((moment, frame),) = look.seen
    assert frame.depth is observation.frame.depth
    assert moment.frame.depth is frame.depth
    assert camera.taken == 1
    np.testing.assert_array_equal(moment.T_base_camera, observation.T_base_camera)
    assert (moment.opening, moment.q.tolist()) == (observation.opening, observation.q.tolist())


@pytest.fixture
def _no_search_for_cycles():
    gc.disable()
    yield
    gc.enable()


@pytest.mark.usefixtures("_no_search_for_cycles")
def test_what_was_seen_is_gone_with_the_last_who_holds_it(look):
    """A program that picks for hours would otherwise keep frames until Python searches all it holds, which is rare."""
    observation = look.observe()
    kept = [weakref.ref(observation), weakref.ref(observation.frame.depth)]
    look.seen.clear()
    del observation
    assert [each() for each in kept] == [None, None]
