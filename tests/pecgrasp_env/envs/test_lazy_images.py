"""Pictures on demand: those of the eager observation, drawn when looked at, and gone once the task moved on."""

import gymnasium as gym
import numpy as np
import pytest

import pecgrasp_env
from grasping import ROBOTIQ_2F_140, CurvaturePlanner, Segmenter
from pecgrasp_env import ScriptedPolicy
from pecgrasp_env.envs.lazy_images import LazyImages
from pecgrasp_env.policy.log import PolicyLog
from pecgrasp_env.policy.observation import DepthFrame, RobotObservation
from pecgrasp_env.policy.pick_planner import PickPlanner
from pecgrasp_env.robot.kinematics import HOME
from pecgrasp_env.sensor import D435

assert pecgrasp_env
ACTION = np.array([*HOME, 0.14, 60.0], np.float32)


def make(on_demand):
    env = gym.make(
        "SelectiveGrasp-v1",
        n_objects=1,
        classes=["plug_adapter"],
        sensor="d435",
        obs_mode="depth+segmentation",
        control_mode="pd_joint_pos",
        sim_backend="physx_cpu",
        render_backend="cpu",
    )
    env.unwrapped.pictures_on_demand = on_demand
    return env


@pytest.fixture(scope="module")
def both():
    envs = make(False), make(True)
    yield envs
    for env in envs:
        env.close()


def test_they_are_the_eager_ones_whenever_somebody_looks(both):
    eager, lazy = ([env.reset(seed=4)[0], *(env.step(ACTION)[0] for _ in range(3))] for env in both)
    last = lazy[-1]["sensor_data"]["wrist_camera"]
    assert sorted(last) == sorted(eager[-1]["sensor_data"]["wrist_camera"]) == ["depth", "segmentation"]
    for kind in last:
        assert np.array_equal(last[kind], eager[-1]["sensor_data"]["wrist_camera"][kind])
    assert last["depth"] is last["depth"]  # one look takes both kinds, once


def test_a_moment_that_has_passed_cannot_be_looked_at(both):
    seen, unseen = both[1].reset(seed=4)[0], both[1].step(ACTION)[0]
    with pytest.raises(RuntimeError, match="depth: nobody looked"):
        seen["sensor_data"]["wrist_camera"]["depth"]
    picture = unseen["sensor_data"]["wrist_camera"]["depth"]
    both[1].step(ACTION)
    assert unseen["sensor_data"]["wrist_camera"]["depth"] is picture


def test_asking_what_there_is_takes_no_picture():
    taken = []
    pictures = LazyImages(["depth"], lambda: taken.append(1) or {"depth": 0.5})
    assert ("depth" in pictures, "rgb" in pictures, list(pictures), len(pictures)) == (True, False, ["depth"], 1)
    assert not taken
    assert pictures["depth"] == pictures["depth"] == 0.5
    assert len(taken) == 1
    with pytest.raises(KeyError):
        pictures["rgb"]


def episode(env):
    """The policy's actions, its log, and for each observation whether it was read while it could be."""
    obs, info = env.reset(seed=4)
    policy = ScriptedPolicy(None)
    policy.reset(info["target"][0])
    actions, seen = [], []
    for _ in range(200):
        actions.append(policy.act(obs).copy())
        seen.append(obs["sensor_data"]["wrist_camera"])
        obs, _, terminated, _, info = env.step(actions[-1])
        if terminated:
            break
    assert info["success"]
    read = 0
    for images in seen:
        try:
            read += images["depth"] is not None
        except RuntimeError:
            continue
    return np.array(actions), policy.log, read


def test_the_policy_acts_the_same_and_reads_few(both):
    (eager, _, given), (lazy, log, read) = map(episode, both)
    assert np.array_equal(eager, lazy)
    assert given == len(eager)
    assert read == log.views == 1  # to find the object; that it is held its fingers feel


def test_rendering_is_not_counted_as_segmenting():
    events = []

    class Log(PolicyLog):
        def timed(self, stage):
            events.append(stage)
            return super().timed(stage)

    def take():
        events.append("render")
        return DepthFrame(np.full((240, 424), 0.5, np.float32), D435["424x240"])

    log = Log()
    planner = PickPlanner(None, CurvaturePlanner(ROBOTIQ_2F_140), Segmenter(), 0.6, "mug", log)
    planner.look(RobotObservation(np.array(HOME), 0.14, take), [])
    assert events == ["render", "segment", "classify"]
    assert set(log.stages) == {"segment", "classify"}
