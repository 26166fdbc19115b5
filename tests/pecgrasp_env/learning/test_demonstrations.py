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
from pecgrasp_env.learning.behaviour_cloning import CloningConfig, load, samples, train
from pecgrasp_env.learning.control_modes import CONTROL_MODES
from pecgrasp_env.learning.demonstrations import DemonstrationError, Recording, record
from pecgrasp_env.learning.state_features import Moments, MomentsError, read_demonstrations, tool

PLANNER = {"_target_": "grasping.CurvaturePlanner"}
RECORDING = Recording(
    {"n_objects": 1, "classes": ["mouse"], "objects": {"seed": 0, "instances_per_class": 4}},
    None,
    PLANNER,
    {"attempts": 1},
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
    replayed = recorded.with_name("trajectory.state.pd_joint_pos.physx_cpu.json")
    assert [episode["success"] for episode in json.loads(replayed.read_text())["episodes"]] == [True, True]


@pytest.mark.parametrize(
    "mode", [pytest.param("pd_ee_delta_pose"), *(pytest.param(m, marks=pytest.mark.slow) for m in CONTROL_MODES[1:3])]
)
def test_maniskills_tool_takes_them_to_other_control_modes(recorded, mode):
    import pecgrasp_env.learning.replay  # noqa: F401  (puts the conversions in)

    arguments = {"target_control_mode": mode, "save_traj": True, "obs_mode": "state"}
    replay_trajectory.main(replay_trajectory.Args(str(recorded), **arguments))
    with h5py.File(recorded.with_name(f"trajectory.state.{mode}.physx_cpu.h5")) as file:
        assert [bool(file[name]["success"][-1]) for name in file] == [True, True]
        assert all(np.isfinite(file[name]["actions"]).all() for name in file)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["pd_ee_pose", "pd_ee_delta_pose"])
def test_tool_actions_are_recorded_and_lead_through_the_same_states(mode, tmp_path):
    assert record(replace(RECORDING, control_mode=mode), SEEDS, tmp_path)["kept"] == 2
    test_the_same_actions_lead_through_the_same_states(tmp_path / "trajectory.h5")


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
    with pytest.raises(DemonstrationError, match="control_mode='pd_ee_twist'"):
        replace(RECORDING, control_mode="pd_ee_twist")
    with pytest.raises(DemonstrationError, match="keep='best'"):
        record(RECORDING, SEEDS, tmp_path, keep="best")
    with pytest.raises(DemonstrationError, match="workers=0"):
        record(RECORDING, SEEDS, tmp_path, workers=0)
    with pytest.raises(DemonstrationError, match="of another recording"):
        record(replace(RECORDING, control_mode="pd_joint_delta_pos"), SEEDS, recorded.parent)


@pytest.mark.slow
def test_processes_and_the_other_control_mode_record_the_same_movement(recorded, tmp_path):
    record(replace(RECORDING, control_mode="pd_joint_delta_pos"), SEEDS, tmp_path, workers=2)
    with h5py.File(recorded) as targets, h5py.File(tmp_path / "trajectory.h5") as steps:
        for name in targets:
            assert np.abs(steps[name]["actions"]).max() <= 1
            a, b = (file[name]["env_states/actors/object_0"][:, :3] for file in (targets, steps))
            # A pixel more or less of the arm in view moves a grasp by a hair, and the end by a step or two.
            assert abs(len(a) - len(b)) <= 3
            assert np.linalg.norm(a[:, None] - b, axis=2).min(axis=0).max() < 5e-3
            assert np.allclose(a[-1], b[-1], atol=5e-3)


# ------------------------------------------------------------------------------------------------ behaviour cloning


def test_an_agent_learns_from_them_and_its_checkpoint_loads(recorded, tmp_path):
    config = CloningConfig(str(recorded), str(tmp_path), epochs=16, batch=16, width=64, copies=1, held_out=0.0)
    config = replace(config, episodes=1, final_episodes=1, most_steps=3)
    results = train(config)
    assert [point["epoch"] for point in results["curve"]] == [0, 1, 2, 4, 8, 16]
    _, first, *_, last = results["curve"]
    assert last["loss"]["train"] < 0.5 * first["loss"]["train"]
    assert results["final"].keys() == {"cloned", "idle", "random"}
    assert list((tmp_path / "tensorboard" / "cloned").glob("events*"))
    net, settings = load(tmp_path)
    (episode, _), _ = read_demonstrations(recorded, settings["chunk"])
    x, y = samples(*episode)
    with torch.inference_mode():
        assert float((net(x) - y).abs().mean()) < 0.5 * first["loss"]["train"]
    assert train(config) == results  # not run again


def test_chunks_are_the_actions_that_follow(recorded):
    ((moments, actions), _), env_kwargs = read_demonstrations(recorded, 3)
    assert env_kwargs["control_mode"] == "pd_joint_pos"
    assert moments.features().shape == (len(actions), 36)
    assert np.array_equal(actions[1:, 0], actions[:-1, 1])
    assert (actions[-1] == actions[-1, 0]).all()


def test_the_tool_is_where_the_simulator_has_it(recorded):
    with h5py.File(recorded) as file:
        obs = load_h5_data(file["traj_0"]["obs"])
    T = tool(obs["agent"]["qpos"][:, :6])
    assert np.allclose(T[:, :3, 3], obs["extra"]["tcp_pose"][:, :3], atol=1e-4)


def test_a_moved_arm_takes_along_what_it_holds_and_nothing_else(recorded):
    ((moments, _), _), _ = read_demonstrations(recorded, 1)
    held = moments.gripper[:, 2] > 2.0
    assert held.any()
    assert not held.all()
    moved = moments.moved(np.full(moments.q.shape, 0.03))
    before, after = (np.linalg.inv(tool(each.q)) @ each.T_world_thing for each in (moments, moved))
    assert np.allclose(after[held], before[held])
    assert np.array_equal(moved.T_world_thing[~held], moments.T_world_thing[~held])
    assert not np.allclose(after[~held], before[~held], atol=5e-3)
    still = moments.moved(np.zeros(moments.q.shape))
    assert torch.allclose(still.features(), moments.features(), atol=1e-6)


def test_features_tell_a_quaternion_and_its_negative_alike(recorded):
    with h5py.File(recorded) as file:
        obs = load_h5_data(file["traj_0"]["obs"])
    before = Moments.of(obs).features()
    obs["extra"]["target_pose"][:, 3:] *= -1
    assert torch.allclose(Moments.of(obs).features(), before, atol=1e-6)


def test_demonstrations_in_another_control_mode_are_refused(tmp_path):
    path = tmp_path / "trajectory.h5"
    h5py.File(path, "w").close()
    episode = {"control_mode": "pd_joint_delta_pos", "episode_id": 0}
    path.with_suffix(".json").write_text(json.dumps({"episodes": [episode]}))
    with pytest.raises(MomentsError, match="control mode pd_joint_delta_pos"):
        read_demonstrations(path, 8)
