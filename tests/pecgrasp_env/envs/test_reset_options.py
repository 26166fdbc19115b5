"""`reset(options=…)`: the class that is asked for, the objects on the table, and errors that name the options."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import torch

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.envs.reset_options import read_options
from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.objects import Catalogue
from pecgrasp_env.scene.actors import Recipe

CLASSES = ("can", "box", "mouse", "stapler")
SOURCE = Catalogue(CLASSES, instances_per_class=3, seed=7)
RECIPE = Recipe(SOURCE, CLASSES, 2, False, None, None)
MAKE = {"render_backend": "cpu", "objects": SOURCE, "n_objects": 2}


@pytest.fixture(scope="module")
def single():
    environment = gym.make("SelectiveGraspSingle-v1", obs_mode="state_dict", **MAKE)
    yield environment
    environment.close()


@pytest.fixture(scope="module")
def fixed():
    """Its objects stay on the table."""
    environment = gym.make("SelectiveGrasp-v1", sim_backend="physx_cpu", reconfiguration_freq=0, **MAKE)
    yield environment
    environment.close()


def instances(env):
    task = getattr(env.unwrapped, "task", env.unwrapped)
    return [model.instance for model in task.models[0]]


@pytest.mark.parametrize("target", CLASSES)
def test_the_class_that_is_asked_for_lies_there_and_is_the_target(single, target):
    obs, info = single.reset(seed=3, options={"target": target})
    assert info["target"] == target
    assert obs["extra"]["target"].argmax() == CLASSES.index(target)
    assert sum(name.startswith(target) for name in instances(single)) == 1
    again, _ = single.reset(seed=3, options={"target": target})
    assert np.array_equal(again["extra"]["object_poses"], obs["extra"]["object_poses"])


def test_a_target_that_lies_there_anyway_changes_nothing_else(single):
    plain, info = single.reset(seed=5)
    for name in {name.rsplit("_", 1)[0] for name in instances(single)}:
        obs, told = single.reset(seed=5, options={"target": name})
        assert told["target"] == name
        assert np.array_equal(obs["extra"]["object_poses"], plain["extra"]["object_poses"])
    assert single.reset(seed=5)[1]["target"] == info["target"]


def test_the_objects_named_lie_there_in_their_order_for_one_episode(single):
    names = ["mouse_0008", "can"]
    first, info = single.reset(seed=1, options={"objects": names})
    lying = instances(single)
    assert lying[0] == "mouse_0008"
    assert lying[1].startswith("can_")
    assert info["target"] in ("mouse", "can")
    again, _ = single.reset(seed=1, options={"objects": names})
    assert instances(single) == lying
    assert np.array_equal(first["extra"]["object_poses"], again["extra"]["object_poses"])
    _, info = single.reset(seed=1, options={"objects": names, "target": "can"})
    assert info["target"] == "can"
    drawn = {tuple(instances(single)) for seed in range(4) if single.reset(seed=seed)}
    assert len(drawn) > 1


def test_two_of_one_class_are_two_instances_and_either_is_right(single):
    _, info = single.reset(seed=2, options={"objects": ["box", "box"]})
    assert info["target"] == "box"
    assert len(set(instances(single))) == 2
    assert single.unwrapped.task.is_target.tolist() == [[True, True]]


def test_where_objects_stay_a_target_must_be_one_of_them(fixed):
    fixed.reset(seed=0, options={"reconfigure": True, "objects": ["can", "stapler"]})
    for target in ("stapler", "can"):
        _, info = fixed.reset(options={"target": [target], "env_idx": torch.tensor([0])})
        assert list(info["target"]) == [target]
    with pytest.raises(TaskError, match=r"'box'.*can, stapler.*reconfigure"):
        fixed.reset(options={"target": "box"})
    _, info = fixed.reset(seed=4, options={"target": "box", "reconfigure": True})
    assert list(info["target"]) == ["box"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"targets": "can"}, "'targets'.*target, objects, strangers, absent, reconfigure, env_idx"),
        ({"target": "unicorn"}, "unicorn.*can, box, mouse, stapler"),
        ({"target": ["can", "box"]}, "one for each of 1"),
        ({"objects": "can"}, "must be a list"),
        ({"objects": []}, "must be a list"),
        ({"objects": ["can"]}, "n_objects=2.*n_objects=1"),
        ({"objects": ["can", "unicorn_0001"]}, "unicorn_0001.*can/can_0007"),
        ({"objects": ["can", "box"], "target": "mouse"}, "'mouse'.*can, box"),
        ({"objects": ["can", "box"], "reset_to_env_states": {}}, "reset_to_env_states"),
    ],
)
def test_options_that_make_no_sense_are_named(single, options, words):
    with pytest.raises(TaskError, match=words):
        single.reset(seed=0, options=options)


def test_each_sub_environment_has_its_own_wish():
    options = {"target": [None, "box"], "objects": [["can", "mouse"], ["box", "can/can_0009"]]}
    theirs, (first, second) = read_options(options, RECIPE, 2)
    assert theirs == {"reconfigure": True}
    assert (first.target, second.target) == (None, 1)
    assert second.objects == (("box", None), ("can", 2))
    some = {"env_idx": torch.tensor([2]), "target": "mouse"}
    _, wishes = read_options(some, RECIPE, 3)
    assert [wish.target for wish in wishes] == [None, None, 2]
    with pytest.raises(TaskError, match="all sub-environments"):
        read_options({"env_idx": [0], "objects": ["can", "box"]}, RECIPE, 2)
    with pytest.raises(TaskError, match="same_class_twins"):
        read_options({"objects": ["can", "box"]}, replace(RECIPE, twins=True), 1)
