"""Pictures on demand: those of the eager observation, drawn when looked at, and gone once the task moved on."""

import gymnasium as gym
import numpy as np
import pytest

import pecgrasp_env
from pecgrasp_env import ScriptedPolicy
from pecgrasp_env.envs.lazy_images import LazyImages
from pecgrasp_env.evaluation.episode import run_episode
from pecgrasp_env.policy import pick_planner as policy
from pecgrasp_env.policy.viewpoints import HOME

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


def test_the_policy_goes_the_same_way_and_looks_seldom(both):
    episodes, looks = [], []
    for env in both:
        task = env.unwrapped
        take, count = task._get_obs_sensor_data, [0]

        def counted(*args, take=take, count=count, **kwargs):
            count[0] += 1
            return take(*args, **kwargs)

        task._get_obs_sensor_data = counted
        episodes.append(run_episode(env, ScriptedPolicy(None), 4))
        looks.append(count[0])
        del task._get_obs_sensor_data
    assert episodes[0].outcome == episodes[1].outcome == "success"
    assert episodes[0].steps == episodes[1].steps == looks[0] - 1
    assert looks[1] == 1  # to find the object; that it is held its fingers feel


def test_drawing_the_picture_is_not_counted_as_segmenting(both, monkeypatch):
    taken = []
    monkeypatch.setattr(policy, "look", lambda observation, _: taken.append("frame" in vars(observation)) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run_episode(both[1], ScriptedPolicy(None), 4)
    assert taken == [True]
