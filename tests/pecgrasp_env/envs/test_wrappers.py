"""ManiSkill's wrappers over the batched form, and processes that were forked from one that has a renderer."""

import json
import multiprocessing

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.vector import AsyncVectorEnv
from mani_skill.utils.wrappers import RecordEpisode
from mani_skill.utils.wrappers.action_repeat import ActionRepeatWrapper
from mani_skill.utils.wrappers.flatten import FlattenRGBDObservationWrapper
from mani_skill.utils.wrappers.frame_stack import FrameStack
from mani_skill.vector.wrappers.gymnasium import ManiSkillVectorEnv

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.envs.validation import ForkError
from pecgrasp_env.envs.words import Words
from pecgrasp_env.objects import LARS_CLASSES

LOOKS = {"sensor_configs": {"width": 32, "height": 24}}


def make(**kwargs):
    options = {"objects": {"instances_per_class": 2}, "sim_backend": "physx_cpu", "render_backend": "cpu"}
    return gym.make("SelectiveGrasp-v1", **(options | {"max_episode_steps": 6} | kwargs))


def test_words_are_taken_by_masks_and_keep_their_length():
    words, longer = Words.of(["can", "box"]), Words.of(["mouse", "plug_adapter"])
    words[torch.tensor([False, True])] = longer[torch.tensor([False, True])]
    assert list(words) == ["can", "plug_adapter"]
    one = Words.of(["can"])
    one[torch.tensor([True])] = Words.of(["stapler"])[torch.tensor([True])]
    assert list(one) == ["stapler"]
    assert list(one[torch.tensor([False])]) == []


def test_an_action_repeated_three_times_is_three_steps():
    repeated = ActionRepeatWrapper(make(reward_mode="dense", max_episode_steps=30), 3)
    plain = make(reward_mode="dense", max_episode_steps=30)
    start = [env.reset(seed=1)[1]["target"][0] for env in (repeated, plain)]
    assert start[0] == start[1]
    action = plain.unwrapped.agent.robot.get_qpos()[0, :6].numpy()
    action = np.array([*(action + 0.02), 0.1, 60.0], np.float32)
    _, reward, *_, info = repeated.step(action)
    single = [plain.step(action) for _ in range(3)]
    assert float(reward) == pytest.approx(sum(float(each[1]) for each in single), abs=1e-6)
    assert info["target"][0] == start[0]
    assert int(info["elapsed_steps"]) == 3
    repeated.close()
    plain.close()


@pytest.mark.parametrize(
    "wrap",
    [
        lambda: FrameStack(FlattenRGBDObservationWrapper(make(obs_mode="depth+segmentation", **LOOKS)), 2),
        lambda: ManiSkillVectorEnv(make(obs_mode="pointcloud", **LOOKS), record_metrics=True),
    ],
)
def test_wrappers_run_over_the_end_of_an_episode(wrap):
    env = wrap()
    env.reset(seed=0)
    for _ in range(8):
        *_, info = env.step(env.action_space.sample())
    assert info["target"][0] in LARS_CLASSES
    env.close()


def test_a_recorder_keeps_what_the_reset_asked_for(tmp_path):
    env = RecordEpisode(make(obs_mode="state_dict"), str(tmp_path), trajectory_name="asked", save_video=False)
    env.reset(seed=3, options={"target": "mouse"})
    for _ in range(6):
        env.step(env.action_space.sample())
    env.close()
    (episode,) = json.loads((tmp_path / "asked.json").read_text())["episodes"]
    assert episode["reset_kwargs"] == {"seed": 3, "options": {"target": "mouse"}}


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
def test_a_fork_is_told_how_processes_are_started():
    def single():
        return gym.make("SelectiveGraspSingle-v1", render_backend="cpu", objects={"instances_per_class": 1})

    vector = AsyncVectorEnv([single, single], context="fork")
    with pytest.raises(ForkError, match="spawn"):
        vector.reset(seed=0)
    vector.close(terminate=True)
