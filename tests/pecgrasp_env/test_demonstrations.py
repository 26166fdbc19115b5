"""Recorded episodes: ManiSkill reads and replays them, a killed recording goes on, an agent learns from them."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import gymnasium as gym
import h5py
import numpy as np
import pytest
import torch
from mani_skill.trajectory import replay_trajectory, utils
from mani_skill.trajectory.dataset import ManiSkillTrajectoryDataset, load_h5_data

from grasping import ROBOTIQ_2F_140
from pecgrasp_env.behaviour_cloning import CloningConfig, CloningError, features, load, read_demonstrations, train
from pecgrasp_env.demonstrations import DemonstrationError, Recording, record

PLANNER = {"_target_": "grasping.CurvaturePlanner"}
RECORDING = Recording(
    {"n_objects": 1, "classes": ["mouse"], "objects": {"seed": 0, "instances_per_class": 4}},
    None,
    PLANNER,
    {"attempts": 1},
    "pd_joint_delta_pos",
)
SEEDS = (500000, 500001)


class Killed(BaseException):
    pass


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """Two episodes; the recording was killed after the first, in the middle of the second."""
    out = tmp_path_factory.mktemp("demos")

    def kill(done, total):
        if done == 1:
            raise Killed

    with pytest.raises(Killed):
        record(RECORDING, SEEDS, out, progress=kill)
    assert not (out / "trajectory.h5").exists()
    (out / "episodes" / f"{SEEDS[1]}.h5").write_bytes(b"torn")
    first = (out / "episodes" / f"{SEEDS[0]}.json").read_bytes()
    results = record(RECORDING, SEEDS, out)
    assert results["kept"] == results["outcomes"]["success"]["count"] == 2
    assert (out / "episodes" / f"{SEEDS[0]}.json").read_bytes() == first
    return out / "trajectory.h5"


def equal(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    return np.array_equal(np.asarray(a).squeeze(), np.asarray(b).squeeze(), equal_nan=True)


def test_maniskills_own_loader_reads_them(recorded):
    data = ManiSkillTrajectoryDataset(str(recorded), success_only=True)
    steps = [episode["elapsed_steps"] for episode in data.episodes]
    assert [episode["episode_seed"] for episode in data.episodes] == list(SEEDS)
    assert len(data) == sum(steps)
    assert data.actions.shape == (sum(steps), 8)
    assert np.abs(data.actions).max() <= 1
    assert data.obs["extra"]["target_pose"].shape == (sum(steps), 7)
    assert data.terminated.sum() == data.success.sum() == 2
    assert data.env_id == "SelectiveGrasp-v1"


def test_the_same_actions_lead_through_the_same_states(recorded):
    info = json.loads(recorded.with_suffix(".json").read_text())
    env = gym.make(info["env_info"]["env_id"], **info["env_info"]["env_kwargs"])
    with h5py.File(recorded) as file:
        for episode in info["episodes"]:
            trajectory = load_h5_data(file[f"traj_{episode['episode_id']}"])
            states = utils.dict_to_list_of_dicts(trajectory["env_states"])
            obs, _ = env.reset(**episode["reset_kwargs"])
            assert equal(env.unwrapped.get_state_dict(), states[0])
            for action, state in zip(trajectory["actions"], states[1:], strict=True):
                obs, *_, last = env.step(action)
                assert equal(env.unwrapped.get_state_dict(), state)
            assert equal(obs, utils.index_dict(trajectory["obs"], -1))
            assert last["success"]
    env.close()


def test_maniskills_tool_replays_them_by_their_states(recorded):
    arguments = {"use_env_states": True, "save_traj": True, "obs_mode": "state"}
    replay_trajectory.main(replay_trajectory.Args(str(recorded), **arguments))
    replayed = recorded.with_name("trajectory.state.pd_joint_delta_pos.physx_cpu.json")
    assert [episode["success"] for episode in json.loads(replayed.read_text())["episodes"]] == [True, True]


def test_episodes_that_fail_are_kept_only_if_asked_for(tmp_path):
    """None does with a planner for a gripper that opens by 12 mm."""
    hand = {"_target_": "grasping.Gripper", **asdict(ROBOTIQ_2F_140), "stroke": 0.012}
    narrow = {**PLANNER, "gripper": hand}
    recording = replace(RECORDING, planner=narrow)
    assert record(recording, [1], tmp_path)["kept"] == 0
    results = record(recording, [1], tmp_path, keep="all")
    assert results["kept"] == 1
    assert results["outcomes"]["success"]["count"] == 0
    (episode,) = json.loads((tmp_path / "trajectory.json").read_text())["episodes"]
    assert not episode["success"]
    assert episode["expert"]["outcome"] == "no_grasp"


def test_bad_arguments_are_refused_by_name(recorded, tmp_path):
    with pytest.raises(DemonstrationError, match="control_mode='pd_ee_pose'"):
        replace(RECORDING, control_mode="pd_ee_pose")
    with pytest.raises(DemonstrationError, match="keep='best'"):
        record(RECORDING, SEEDS, tmp_path, keep="best")
    with pytest.raises(DemonstrationError, match="workers=0"):
        record(RECORDING, SEEDS, tmp_path, workers=0)
    with pytest.raises(DemonstrationError, match="of another recording"):
        record(replace(RECORDING, control_mode="pd_joint_pos"), SEEDS, recorded.parent)


@pytest.mark.slow
def test_processes_and_the_other_control_mode_record_the_same_movement(recorded, tmp_path):
    record(replace(RECORDING, control_mode="pd_joint_pos"), SEEDS, tmp_path, workers=2)
    with h5py.File(recorded) as steps, h5py.File(tmp_path / "trajectory.h5") as targets:
        for name in steps:
            a, b = (file[name]["env_states/actors/object_0"][:, :3] for file in (steps, targets))
            assert len(a) == len(b)
            assert np.allclose(a, b, atol=5e-3)


# ------------------------------------------------------------------------------------------------ behaviour cloning


def test_an_agent_learns_from_them_and_its_checkpoint_loads(recorded, tmp_path):
    config = CloningConfig(str(recorded), str(tmp_path), epochs=40, batch=16, width=64, held_out=0.0, evaluate_every=40)
    config = replace(config, episodes=1, final_episodes=1, most_steps=3)
    results = train(config)
    first, last = results["curve"]
    assert last["loss"]["train"] < 0.5 * first["loss"]["train"]
    assert results["final"].keys() == {"cloned", "idle", "random"}
    assert list((tmp_path / "tensorboard" / "cloned").glob("events*"))
    net, settings = load(tmp_path)
    ((x, y), _), _ = read_demonstrations(recorded, settings["chunk"])
    with torch.inference_mode():
        assert float((net(x) - y).abs().mean()) == pytest.approx(last["loss"]["train"], rel=0.5)
    assert train(config) == results  # not run again


def test_chunks_are_the_actions_that_follow(recorded):
    (episode, _), env_kwargs = read_demonstrations(recorded, 3)
    x, y = episode
    assert env_kwargs["control_mode"] == "pd_joint_delta_pos"
    assert x.shape == (len(y), 30)
    assert torch.equal(y[1:, 0], y[:-1, 1])
    assert torch.equal(y[-1], y[-1, :1].expand(3, -1))


def test_features_tell_a_quaternion_and_its_negative_alike(recorded):
    with h5py.File(recorded) as file:
        obs = load_h5_data(file["traj_0"]["obs"])
    before = features(obs)
    obs["extra"]["target_pose"][:, 3:] *= -1
    assert torch.equal(features(obs), before)


def test_demonstrations_in_another_control_mode_are_refused(tmp_path):
    path = tmp_path / "trajectory.h5"
    h5py.File(path, "w").close()
    path.with_suffix(".json").write_text(json.dumps({"episodes": [{"control_mode": "pd_joint_pos", "episode_id": 0}]}))
    with pytest.raises(CloningError, match="control mode pd_joint_pos"):
        read_demonstrations(path, 8)
