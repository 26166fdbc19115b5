"""DualGrasp-v1: spaces, seeds, what is judged, what a hand bears, states, arguments."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env, data_equivalence

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.envs.dual import state
from pecgrasp_env.envs.dual.dual_grasp import DualGraspEnv
from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.robot.two_arm_bases import T_WORLD_BASE, WAITING

WAIT = np.concatenate([[*q, 0.14, 60.0] for q in WAITING]).astype(np.float32)


def make(**kwargs):
    return gym.make("DualGrasp-v1", **({"obs_mode": "state", "render_backend": "cpu"} | kwargs))


@pytest.fixture(scope="module")
def env():
    environment = make(obs_mode="state_dict", control_mode="pd_joint_pos", reward_mode="dense")
    yield environment
    environment.close()


def plain(value):
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    return value.numpy() if isinstance(value, torch.Tensor) else value


def test_the_docstring_is_a_card():
    lines = [line.strip() for line in DualGraspEnv.__doc__.splitlines()]
    headings = [line[3:] for line in lines if line.startswith("## ")]
    assert headings[:4] == ["Description", "Action Space", "Observation Space", "Rewards"]
    assert headings[4:] == ["Starting State", "Episode End", "Arguments", "Version History"]


@pytest.mark.slow
def test_the_environment_checker_has_nothing_to_say():
    environment = gym.make("DualGraspSingle-v1", render_backend="cpu")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment.unwrapped, skip_render_check=True)
    assert np.isfinite(environment.observation_space.low).all()
    assert environment.action_space.shape == (16,)
    environment.close()


def test_a_seed_fixes_everything(env):
    runs = []
    for _ in range(2):
        obs, info = env.reset(seed=5)
        steps = [plain(env.step(WAIT)[:2]) for _ in range(3)]
        runs.append((plain(obs), str(info["object"][0]), steps))
    assert data_equivalence(runs[0][0], runs[1][0], exact=True)
    assert runs[0][1] == runs[1][1]
    assert env.reset(seed=6)[1]["object"][0] != runs[0][1]


def test_the_start_is_what_the_card_says(env):
    for seed in range(3):
        obs, info = env.reset(seed=seed)
        assert env.observation_space.contains(plain(obs))
        goal = obs["extra"]["goal"][0].numpy()
        assert 0.15 <= goal[2] <= 0.22
        assert 0.05 <= np.hypot(*goal[:2]) <= 0.10
        assert 1.0 <= float(info["mass"]) <= 6.0
        assert abs(float(info["height"])) < 0.002
        assert float(info["tilt"]) < 1e-3
        assert not info["holds"].any()
        np.testing.assert_array_equal(info["centre_of_mass"], obs["extra"]["object_pose"][:, :3])
        tools = obs["extra"]["tcp_poses"].reshape(2, 7)[:, 1]
        assert (tools > 0.3).all()  # beside the middle
        for arm, T in zip(env.unwrapped.agent.arms, T_WORLD_BASE, strict=True):
            np.testing.assert_allclose(arm.robot.pose.to_transformation_matrix()[0], T, atol=1e-6)


def test_waiting_earns_nothing_and_ends_nothing(env):
    env.reset(seed=1)
    steps = [env.step(WAIT) for _ in range(5)]
    assert abs(sum(float(reward) for _, reward, *_ in steps)) < 0.02
    assert not any(bool(terminated) for *_, terminated, _, _ in steps)


def test_an_episode_goes_on_from_its_state(env):
    env.reset(seed=2)
    other = WAIT.copy()
    other[[0, 8]] += 0.2
    env.step(other)
    kept = env.unwrapped.get_state_dict()
    flat = env.unwrapped.get_state().clone()
    before = plain(env.unwrapped.memory.to_state())
    ahead = plain(env.step(other)[0])
    env.step(WAIT)
    for put_back in (lambda: env.unwrapped.set_state_dict(kept), lambda: env.unwrapped.set_state(flat)):
        put_back()
        assert data_equivalence(plain(env.unwrapped.memory.to_state()), before, exact=True)
        again = plain(env.step(other)[0])
        for arm in ("arm_0", "arm_1"):
            np.testing.assert_allclose(again["agent"][arm]["qpos"], ahead["agent"][arm]["qpos"], atol=1e-4)
    env.reset(seed=3)
    with pytest.raises(TaskError, match="another object"):
        env.unwrapped.set_state_dict(kept)


# ----------------------------------------------------------------------------------------------------- judgement


def judged(angle=0.0, height=0.2, moved=(0.0, 0.0, 0.2), holds=(True, True), stop=True, overloaded=False):
    memory = state.DualMemory.empty(torch.zeros(1, dtype=torch.long), torch.zeros(1, dtype=torch.long))
    start = torch.tensor([[0.4, 0.1, 0.02, 1.0, 0.0, 0.0, 0.0]])
    memory.begin(start, torch.tensor([[0.0, 0.0, 0.2]]), torch.zeros(1, dtype=torch.long))
    turn = [np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0]
    pose = torch.tensor([[0.4 + moved[0], 0.1 + moved[1], 0.02 + moved[2], *turn]], dtype=torch.float32)
    memory.before = pose[:, :3].clone()
    memory.overloaded[:] = overloaded
    return state.judge(memory, pose, torch.tensor([height]), torch.tensor([holds]), 20.0, stop)


@pytest.mark.parametrize(
    ("kwargs", "success", "level", "fail"),
    [
        ({}, True, True, False),
        ({"holds": (True, False)}, False, True, False),
        ({"holds": (False, False)}, False, False, False),
        ({"angle": np.radians(9.9)}, True, True, False),
        ({"angle": np.radians(10.1)}, False, False, True),
        ({"moved": (0.0, 0.0, 0.16)}, False, False, False),
        ({"height": -0.1}, False, False, True),
        ({"overloaded": True}, False, False, True),
        ({"overloaded": True, "stop": False}, True, True, False),
    ],
)
def test_what_is_a_success_and_what_a_failure(kwargs, success, level, fail):
    found = judged(**kwargs)
    assert (bool(found["success"]), bool(found["carried_level"]), bool(found["fail"])) == (success, level, fail)


def test_tilt_is_against_how_it_rested_and_not_about_the_vertical():
    start = torch.tensor([[0.0, 0, 0, np.cos(0.2), np.sin(0.2), 0, 0]], dtype=torch.float32)
    about_z = torch.tensor([np.cos(0.4), 0, 0, np.sin(0.4)])
    turned = torch.tensor([[0.0, 0, 0, *_product(about_z, start[0, 3:])]])
    assert float(state.tilt_from(start, turned)) == pytest.approx(0.0, abs=1e-6)
    tilted = torch.tensor([[0.0, 0, 0, np.cos(0.25), np.sin(0.25), 0, 0]], dtype=torch.float32)
    assert float(state.tilt_from(start, tilted)) == pytest.approx(0.1, abs=1e-6)


def _product(a, b):
    (w, x, y, z), (p, q, r, s) = a.tolist(), b.tolist()
    real = w * p - x * q - y * r - z * s
    return real, w * q + x * p + y * s - z * r, w * r - x * s + y * p + z * q, w * s + x * r - y * q + z * p


def test_hands_bear_a_weight_by_the_lever_rule():
    hands = torch.tensor([[[0.0, -0.1, 0.3], [0.0, 0.3, 0.3]]])
    centre, up = torch.tensor([[0.02, 0.0, 0.3]]), torch.tensor([0.1])
    both, one, none = (torch.tensor([each]) for each in ((True, True), (False, True), (False, False)))
    weight = 2.0 * state.GRAVITY
    np.testing.assert_allclose(state.loads_of(2.0, centre, hands, both, up), [[0.75 * weight, 0.25 * weight]])
    np.testing.assert_allclose(state.loads_of(2.0, centre, hands, one, up), [[0.0, weight]])
    np.testing.assert_allclose(state.loads_of(2.0, centre, hands, none, up), [[0.0, 0.0]])
    np.testing.assert_allclose(state.loads_of(2.0, centre, hands, both, 0 * up), [[0.0, 0.0]])


def test_an_arm_is_overloaded_by_what_lasts():
    memory = state.DualMemory.empty(torch.zeros(1, dtype=torch.long), torch.zeros(1, dtype=torch.long))
    pose, up = torch.tensor([[0.0, 0, 0, 1, 0, 0, 0]]), torch.tensor([0.1])
    heavy = torch.tensor([[0.0, (state.PAYLOAD_KG - state.HAND_KG) * state.GRAVITY + 0.1]])
    for loads in (heavy, heavy, 0 * heavy, heavy, heavy, heavy):
        memory.loads = loads
        memory.note(pose, up)
    assert not memory.overloaded.any()
    memory.note(pose, up)
    assert memory.overloaded.all()
    same = state.DualMemory.empty(memory.kind, memory.instance)
    same.restore(memory.to_state())
    assert all(
        torch.equal(a, b) or torch.isnan(a).all()
        for a, b in zip(vars(memory).values(), vars(same).values(), strict=True)
    )


# ----------------------------------------------------------------------------------------------------- arguments


@pytest.mark.parametrize(
    ("kwargs", "error", "words"),
    [
        ({"kinds": ["plank"]}, TaskError, "kinds="),
        ({"kinds": []}, TaskError, "kinds="),
        ({"joint_noise": -1}, TaskError, "joint_noise=-1"),
        ({"num_envs": 2}, TaskError, "num_envs=2"),
        ({"sim_backend": "physx_cuda"}, TaskError, "sim_backend='physx_cuda'"),
        ({"robot_uids": "panda"}, TaskError, "robot_uids='panda'"),
        ({"sensor": "d4"}, TaskError, "sensor='d4'"),
        ({"n_objects": 3}, TypeError, "DualGrasp has no such argument"),
        ({"obs_mode": "pictures"}, TaskError, "obs_mode='pictures'"),
    ],
)
def test_what_makes_no_sense_is_named(kwargs, error, words):
    with pytest.raises(error, match=words):
        make(**kwargs)
