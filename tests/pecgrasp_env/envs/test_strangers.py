"""Strangers on the table, and a class that is asked for and not there: draws, the answer, outcomes, rewards, states."""

import gymnasium as gym
import numpy as np
import pytest
import torch
import trimesh
from gymnasium.utils.env_checker import check_env

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.objects import Catalogue, ObjectError
from pecgrasp_env.objects.strangers import UNKNOWN, StrangerMeshes
from pecgrasp_env.robot import UR5Robotiq2F140

CLASSES = ("can", "mouse", "box", "stapler")
SOURCE = Catalogue(CLASSES, instances_per_class=2)
HOME = np.array([*UR5Robotiq2F140.keyframes["home"].qpos[:6], 0.14, 60.0], np.float32)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three things that are of no class: the meshes lie in it directly."""
    path = tmp_path_factory.mktemp("strangers")
    trimesh.creation.box((0.05, 0.04, 0.03)).export(path / "brick.ply")
    trimesh.creation.cylinder(0.02, 0.06).export(path / "peg.ply")
    trimesh.creation.icosphere(2, 0.025).export(path / "ball.ply")
    return path


def make(env_id="SelectiveGrasp-v1", **kwargs):
    defaults = {"obs_mode": "state_dict", "render_backend": "cpu", "objects": SOURCE}
    if env_id == "SelectiveGrasp-v1":
        defaults |= {"control_mode": "pd_joint_pos", "sim_backend": "physx_cpu", "reward_mode": "dense"}
    return gym.make(env_id, **(defaults | kwargs))


@pytest.fixture(scope="module")
def among(folder):
    """Two known objects among two strangers."""
    environment = make(n_objects=2, n_strangers=2, strangers=str(folder))
    yield environment
    environment.close()


@pytest.fixture(scope="module")
def maybe():
    """The asked-for class is there in half of the episodes."""
    environment = make(n_objects=2, absent=0.5)
    yield environment
    environment.close()


def classes(env):
    return [model.class_name for model in env.unwrapped.models[0]]


def instances(env):
    return [model.instance for model in env.unwrapped.models[0]]


def said(yes):
    return np.array([*HOME, 1.0 if yes else -1.0], np.float32)


# ----------------------------------------------------------------------------------------------------- strangers


def test_strangers_lie_among_the_objects_and_are_never_asked_for(among):
    places = set()
    for seed in range(8):
        obs, info = among.reset(seed=seed)
        task = among.unwrapped
        names = classes(among)
        assert names.count(UNKNOWN) == 2
        assert len(set(instances(among))) == 4
        assert info["target"][0] in names
        assert info["target"][0] != UNKNOWN
        assert task.is_stranger[0].tolist() == [name == UNKNOWN for name in names]
        assert not (task.is_target & task.is_stranger).any()
        assert obs["extra"]["object_poses"].shape == (1, 28)
        assert obs["extra"]["target"].shape == (1, 4)
        places.add(tuple(task.is_stranger[0].tolist()))
    assert len(places) > 2  # an object's number does not say what it is


def test_the_known_objects_of_a_seed_are_those_without_strangers(among):
    alone = make(n_objects=2)
    for seed in range(3):
        among.reset(seed=seed)
        alone.reset(seed=seed)
        assert [name for name in instances(among) if name not in ("brick", "peg", "ball")] == instances(alone)
    alone.close()


@pytest.mark.slow
def test_without_a_folder_strangers_are_composed():
    environment = make(n_objects=2, n_strangers=2)
    environment.reset(seed=0)
    first = instances(environment)
    assert sum(name.startswith("stranger_") for name in first) == 2
    environment.reset(seed=1)
    environment.reset(seed=0)
    assert instances(environment) == first
    environment.close()


def test_strangers_can_be_named(among):
    among.reset(seed=1, options={"strangers": ["peg", "peg"], "objects": ["mouse", "can"]})
    assert sorted(instances(among))[-2:] == ["peg", "peg"]
    assert [name for name in classes(among) if name != UNKNOWN] == ["mouse", "can"]
    with pytest.raises(TaskError, match=r"'pge'.*peg"):
        among.reset(options={"strangers": ["pge", "peg"]})
    with pytest.raises(TaskError, match="n_strangers=2"):
        among.reset(options={"strangers": ["peg"]})


def test_a_lifted_stranger_is_a_wrong_object(among):
    among.reset(seed=2)
    task = among.unwrapped
    for stranger in (True, False):
        among.reset(seed=2)
        slot = int((task.is_stranger if stranger else ~task.is_stranger & ~task.is_target)[0].nonzero()[0])
        task.objects[slot].set_linear_velocity(torch.tensor([[0.0, 0.0, 2.0]]))
        for _ in range(8):
            *_, terminated, _, info = among.step(HOME)
            if terminated:
                break
        assert bool(info["wrong_object"])
        assert bool(info["fail"])
        assert bool(info["stranger_lifted"]) == stranger


@pytest.mark.parametrize("clutter", ["close", "touching", "piled", "bin"])
def test_strangers_lie_in_every_clutter(folder, clutter):
    environment = make(n_objects=2, n_strangers=2, strangers=folder, clutter=clutter)
    environment.reset(seed=0)
    assert classes(environment).count(UNKNOWN) == 2
    state = environment.unwrapped.get_state()
    environment.step(HOME)
    environment.unwrapped.set_state(state)
    assert np.array_equal(environment.unwrapped.get_state(), state, equal_nan=True)
    environment.close()


def test_meshes_in_subfolders_are_named_by_both(tmp_path):
    for name in ("toys/duck", "tools/file"):
        (tmp_path / name).parent.mkdir()
        trimesh.creation.box((0.03, 0.02, 0.02)).export(tmp_path / f"{name}.ply")
    strangers = StrangerMeshes(tmp_path)
    assert strangers.names == ["tools/file", "toys/duck"]
    assert (strangers.load(1).class_name, strangers.load(1).instance) == (UNKNOWN, "toys/duck")


# -------------------------------------------------------------------------------------------------------- absence


@pytest.mark.slow
def test_both_cases_come_and_what_lies_there_does_not_tell(maybe):
    absent, kinds = [], {True: set(), False: set()}
    for seed in range(24):
        obs, info = maybe.reset(seed=seed)
        away = info["target"][0] not in classes(maybe)
        assert bool(info["absent"]) == away
        assert not bool(info["said_absent"])
        assert bool((obs["extra"]["target_pose"] == 0).all()) == away
        assert bool(torch.isinf(info["target_distance"])) == away
        absent.append(away)
        kinds[away].add(len(set(classes(maybe))))
    assert 6 <= sum(absent) <= 18
    assert kinds[True] == kinds[False] == {2}


@pytest.mark.parametrize("mode", ["pd_joint_pos", "pd_joint_delta_pos", "pd_ee_pose", "pd_ee_delta_pose"])
def test_every_control_mode_has_the_answer_and_moves_as_without(mode):
    plain, answering = (make(control_mode=mode, n_objects=2, joint_noise=0.0, **more) for more in ({}, {"absent": 0.5}))
    space, longer = plain.unwrapped.single_action_space, answering.unwrapped.single_action_space
    assert longer.shape == (9,)
    assert np.array_equal(longer.low[:8], space.low)
    assert (longer.low[8], longer.high[8]) == (-1, 1)
    plain.reset(seed=0)
    answering.reset(seed=0)
    still = np.zeros(8, np.float32)
    if mode == "pd_joint_pos":
        still = HOME
    elif mode == "pd_ee_pose":
        still[:3], still[6:] = (0.4, 0.0, 0.4), (0.14, 60.0)
    for _ in range(3):
        left = plain.step(still)[0]["agent"]["qpos"]
        right = answering.step(np.append(still, np.float32(0.0)))[0]["agent"]["qpos"]
    assert torch.equal(left, right)
    plain.close()
    answering.close()


@pytest.mark.parametrize("absent", [True, False])
def test_to_say_so_ends_the_episode_well_only_where_it_is_absent(maybe, absent):
    maybe.reset(seed=3, options={"absent": absent})
    _, _, terminated, _, info = maybe.step(said(False))
    assert not bool(terminated)
    _, reward, terminated, _, info = maybe.step(said(True))
    assert bool(terminated)
    assert bool(info["said_absent"])
    assert (bool(info["success"]), bool(info["fail"])) == (absent, not absent)
    assert float(reward) == pytest.approx(5.0 if absent else -1.0, abs=0.05)
    maybe.reset(seed=3)
    assert not bool(maybe.step(said(False))[4]["said_absent"])


def test_idling_and_lifting_pay_nothing_where_the_class_is_absent(maybe):
    maybe.reset(seed=4, options={"absent": True})
    assert sum(float(maybe.step(said(False))[1]) for _ in range(5)) == 0.0
    task = maybe.unwrapped
    task.objects[0].set_linear_velocity(torch.tensor([[0.0, 0.0, 2.0]]))
    for _ in range(8):
        *_, terminated, _, info = maybe.step(said(False))
        if terminated:
            break
    assert bool(info["wrong_object"])
    assert not bool(info["success"])


@pytest.mark.slow
def test_a_target_is_there_or_away_as_it_is_wished(maybe):
    for absent in (True, False):
        for seed in range(4):
            _, info = maybe.reset(seed=seed, options={"target": "box", "absent": absent})
            assert info["target"][0] == "box"
            assert ("box" in classes(maybe)) != absent
    seen = {"box" in classes(maybe) for seed in range(12) if maybe.reset(seed=seed, options={"target": "box"})}
    assert seen == {True, False}
    _, info = maybe.reset(seed=0, options={"objects": ["can", "mouse"], "target": "box"})
    assert bool(info["absent"])
    with pytest.raises(TaskError, match=r"'absent': True.*box"):
        maybe.reset(options={"objects": ["can", "box"], "target": "box", "absent": True})
    with pytest.raises(TaskError, match="'absent': 'no'"):
        maybe.reset(options={"absent": "no"})


def test_what_was_said_belongs_to_the_state(maybe):
    maybe.reset(seed=5, options={"absent": True})
    before = maybe.unwrapped.get_state()
    maybe.step(said(True))
    after = maybe.unwrapped.get_state()
    maybe.unwrapped.set_state(before)
    assert not bool(maybe.unwrapped.evaluate()["success"])
    maybe.unwrapped.set_state(after)
    assert bool(maybe.unwrapped.evaluate()["success"])
    assert torch.equal(maybe.unwrapped.get_state(), after)


def test_objects_that_stay_are_asked_for_or_one_that_is_away():
    environment = make(n_objects=2, absent=0.5, reconfiguration_freq=0)
    environment.reset(seed=0)
    there, asked = classes(environment), set()
    for seed in range(12):
        asked.add(environment.reset(seed=seed)[1]["target"][0] in there)
        assert classes(environment) == there
    assert asked == {True, False}
    away = next(name for name in CLASSES if name not in there)
    assert bool(environment.reset(options={"target": away})[1]["absent"])
    with pytest.raises(TaskError, match=f"'target': '{away}'"):
        environment.reset(options={"target": away, "absent": False})
    environment.close()


@pytest.mark.filterwarnings("error")
def test_the_environment_checker_has_nothing_to_say(folder):
    env = make("SelectiveGraspSingle-v1", n_objects=2, n_strangers=1, strangers=str(folder), absent=0.5)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.action_space.shape == (9,)
    env.close()


# ------------------------------------------------------------------------------------------------------ arguments


@pytest.mark.parametrize(
    ("kwargs", "error", "words"),
    [
        ({"n_strangers": -1}, TaskError, "n_strangers=-1"),
        ({"n_strangers": 8}, TaskError, "n_strangers=8.*0 and 7.*'apart'"),
        (
            {"n_strangers": 7, "n_objects": 2, "strangers": "."},
            TaskError,
            "n_objects=2.*1 and 1.*n_strangers=7.*'piled' 8",
        ),
        ({"n_strangers": 1, "strangers": "/no/such/folder"}, ObjectError, "strangers='/no/such/folder'"),
        ({"absent": 1.5}, TaskError, r"absent=1\.5"),
        ({"absent": float("nan")}, TaskError, "absent=nan"),
        ({"absent": True, "classes": ("can",), "n_objects": 1}, TaskError, "absent=True.*another class"),
        ({"absent": True, "classes": ("can", "box"), "n_objects": 2}, TaskError, "n_objects=2.*stays away"),
        ({"n_strangers": 1, "strangers": ".", "classes": ("can", "unknown")}, TaskError, "unknown"),
    ],
)
def test_arguments_that_make_no_sense_are_named(kwargs, error, words):
    with pytest.raises(error, match=words):
        make(**kwargs)


def test_without_the_argument_absence_cannot_be_wished(among):
    with pytest.raises(TaskError, match=r"'absent': True.*absent=True"):
        among.reset(options={"absent": True})
