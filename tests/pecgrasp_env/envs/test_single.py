"""SelectiveGraspSingle-v1: what Gymnasium asks of an environment, and that many of it agree with one."""

import os
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.utils.passive_env_checker import env_render_passive_checker

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.objects import LARS_CLASSES, Catalogue

SOURCE = Catalogue(LARS_CLASSES, instances_per_class=2)


def make(**kwargs):
    return gym.make("SelectiveGraspSingle-v1", **({"render_backend": "cpu", "objects": SOURCE} | kwargs))


@pytest.fixture
def strict():
    """Warnings are errors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.usefixtures("strict")
@pytest.mark.parametrize(
    "kwargs", [pytest.param({}, marks=pytest.mark.slow), {"obs_mode": "cloud", "text_target": True}]
)
def test_the_environment_checker_has_nothing_to_say(kwargs):
    env = make(**kwargs)
    check_env(env.unwrapped, skip_render_check=True)  # it would open a window for the mode "human"
    env.close()
    env.close()


@pytest.mark.usefixtures("strict")
def test_pictures_are_what_gymnasium_expects():
    env = make(render_mode="rgb_array", human_render_camera_configs={"width": 96, "height": 64})
    env.reset(seed=0)
    env_render_passive_checker(env.unwrapped)
    picture = env.render()
    assert picture.shape == (64, 96, 3)
    assert np.ptp(picture) > 50
    assert not np.shares_memory(picture, env.render())
    env.close()


@pytest.mark.slow
def test_twins_of_one_seed_agree_over_two_hundred_steps():
    first, second = make(control_mode="pd_joint_delta_pos"), make(control_mode="pd_joint_delta_pos")
    rng = np.random.default_rng(0)
    assert data_equivalence(first.reset(seed=11), second.reset(seed=11), exact=True)
    rewards = []
    for step in range(200):
        action = rng.uniform(-0.5, 0.5, 8).astype(np.float32)
        left, right = first.step(action), second.step(action)
        assert data_equivalence(left, right, exact=True)
        rewards.append(left[1])
        if left[2]:
            assert data_equivalence(first.reset(seed=step), second.reset(seed=step), exact=True)
    assert np.ptp(rewards) > 0
    first.close()
    second.close()


def test_it_is_the_batched_environment_without_the_batch():
    single = make(obs_mode="state_dict", control_mode="pd_joint_delta_pos", reward_mode="dense")
    batched = gym.make(
        "SelectiveGrasp-v1",
        obs_mode="state_dict",
        control_mode="pd_joint_delta_pos",
        reward_mode="dense",
        sim_backend="physx_cpu",
        render_backend="cpu",
        objects=SOURCE,
    )
    plain, _ = single.reset(seed=5)
    batch, _ = batched.reset(seed=5)
    action = np.full(8, 0.2, np.float32)
    for _ in range(5):
        assert np.array_equal(plain["extra"]["object_poses"], batch["extra"]["object_poses"][0])
        assert np.array_equal(plain["agent"]["qpos"], batch["agent"]["qpos"][0])
        plain, reward, terminated, truncated, info = single.step(action)
        batch, rewards, *_ = batched.step(action)
        assert reward == float(rewards[0])
        assert (type(terminated), type(truncated), type(info["success"])) == (bool, bool, bool)
        assert info["target"] in LARS_CLASSES
    single.close()
    batched.close()


def test_time_is_truncation_and_failure_is_termination():
    env = make(control_mode="pd_joint_delta_pos", max_episode_steps=3)
    env.reset(seed=0)
    still = np.zeros(8, np.float32)
    assert [env.step(still)[2:4] for _ in range(3)] == [(False, False), (False, False), (False, True)]
    env.reset(seed=0)
    victim = env.unwrapped.task.objects[0]
    pose = victim.pose.raw_pose.clone()
    pose[:, 1] += 2.0  # beside the table
    victim.set_pose(pose)
    ends = [env.step(still) for _ in range(3)]
    assert ends[-1][4]["off_table"]
    assert ends[-1][2]
    env.close()


def test_the_asked_for_class_is_there_as_a_word_and_as_a_number():
    env = make(obs_mode="state_dict", text_target=True)
    for seed in range(3):
        obs, info = env.reset(seed=seed)
        assert env.observation_space.contains(obs)
        assert obs["target_name"] == info["target"] == LARS_CLASSES[int(obs["extra"]["target"].argmax())]
    env.close()


def test_a_cpu_simulates_one_batch_of_one_and_many_single_ones():
    """A batch on the CPU is refused, with the way there: `make_vec` of single ones."""
    options = {"render_backend": "cpu", "objects": SOURCE, "obs_mode": "state"}
    with pytest.raises(TaskError, match=r"num_envs=4.*make_vec\(.SelectiveGraspSingle-v1., num_envs=4.*spawn"):
        gym.make("SelectiveGrasp-v1", num_envs=4, sim_backend="physx_cpu", **options)
    vector = gym.make_vec("SelectiveGraspSingle-v1", num_envs=4, vectorization_mode="sync", **options)
    seeds = [3, 4, 5, 3]
    together, infos = vector.reset(seed=seeds)
    after, rewards, terminated, truncated, _ = vector.step(np.full((4, 8), 0.3, np.float32))
    vector.close()
    assert together.shape == after.shape == (4, *vector.single_observation_space.shape)
    assert rewards.shape == (4,)
    assert not (terminated | truncated).any()
    assert all(name in LARS_CLASSES for name in infos["target"])
    assert np.array_equal(together[0], together[3])
    assert np.array_equal(after[0], after[3])
    assert not np.array_equal(together[0], together[1])


@pytest.mark.slow
def test_processes_agree_with_one_another_and_with_this_one():
    """As many environments as one likes: number i with seed s is the single one with seed s."""
    single = make(control_mode="pd_joint_delta_pos")
    vector = gym.make_vec(
        "SelectiveGraspSingle-v1",
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": "spawn"},  # the renderer does not survive a fork
        render_backend="cpu",
        objects=SOURCE,
        control_mode="pd_joint_delta_pos",
    )
    together, infos = vector.reset(seed=[7, 8])
    action = np.full((2, 8), 0.3, np.float32)
    after, rewards, _, _, _ = vector.step(action)
    for i, seed in enumerate((7, 8)):
        alone, info = single.reset(seed=seed)
        assert np.array_equal(together[i], alone)
        assert infos["target"][i] == info["target"]
        alone, reward, *_ = single.step(action[i])
        assert np.array_equal(after[i], alone)
        assert rewards[i] == reward
    vector.close()
    single.close()


@pytest.mark.parametrize("obs_mode", ["pointcloud", "sensor_data", "segmentation+state"])
def test_every_mode_but_none_is_a_gymnasium_environment(obs_mode):
    env = make(obs_mode=obs_mode, sensor_configs={"width": 32, "height": 24})
    obs, _ = env.reset(seed=0)
    assert env.observation_space.contains(obs)
    assert env.observation_space.contains(env.step(env.action_space.sample())[0])
    env.close()


@pytest.mark.parametrize(
    ("kwargs", "words"),
    [
        ({"num_envs": 2}, "num_envs=2.*make_vec.*spawn"),
        ({"obs_mode": "none"}, "obs_mode='none'.*state, state_dict, sensor_data"),
        ({"render_mode": "film"}, "render_mode='film'"),
        ({"text_target": True}, "text_target=True"),
        ({"obs_mode": "cloud", "cloud_points": 0}, "cloud_points=0"),
        ({"obs_mode": "cloud", "cloud_points": 10**6}, "cloud_points=1000000"),
        ({"light": "blue"}, "light='blue'"),
        ({"friction": (0.9, 0.3)}, "friction"),
        ({"mass_scale": (0.0, 1.0)}, "mass_scale"),
    ],
)
def test_arguments_that_make_no_sense_are_named(kwargs, words):
    with pytest.raises(TaskError, match=words):
        gym.make("SelectiveGraspSingle-v1", disable_env_checker=True, **({"render_backend": "cpu"} | kwargs))


@pytest.mark.slow
def test_a_thousand_episodes_leave_no_memory_behind():
    env = make(control_mode="pd_joint_delta_pos")
    rng = np.random.default_rng(0)
    sizes = []
    for episode in range(1000):
        env.reset(seed=episode)
        for _ in range(20):
            if env.step(rng.uniform(-0.3, 0.3, 8).astype(np.float32))[2]:
                break
        if episode % 100 == 99:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            sizes.append(pages * os.sysconf("SC_PAGE_SIZE") / 2**20)
    env.close()
    # The first hundred load every object once.
    assert sizes[-1] - sizes[0] < 10  # MiB
