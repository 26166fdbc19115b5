"""The task's memory: what a state holds, what pads feel, what is drawn at random, and what a step is paid for."""

from itertools import pairwise

import gymnasium as gym
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from mani_skill.utils.structs.pose import Pose
from sapien.render import RenderDirectionalLightComponent

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.envs.cloud_observation import CLOUD_HIGH, CLOUD_LOW, sample_cloud
from pecgrasp_env.envs.contacts import pad_forces, pads_centre, squeeze
from pecgrasp_env.envs.reward import potential, reward
from pecgrasp_env.envs.selective_grasp import SelectiveGraspEnv
from pecgrasp_env.envs.task_state import LIFT_HEIGHT, Memory
from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.objects import LARS_CLASSES, Catalogue
from pecgrasp_env.robot import UR5Robotiq2F140, gripper_linkage
from pecgrasp_env.robot.pad_contact import both_press, held_between, outward

SOURCE = Catalogue(LARS_CLASSES, instances_per_class=2)
HOME = np.array([*UR5Robotiq2F140.keyframes["home"].qpos[:6], 0.14, 60.0], np.float32)


def make(**kwargs):
    defaults = {
        "obs_mode": "state_dict",
        "control_mode": "pd_joint_pos",
        "sim_backend": "physx_cpu",
        "render_backend": "cpu",
        "objects": SOURCE,
        "reward_mode": "dense",
    }
    return gym.make("SelectiveGrasp-v1", **(defaults | kwargs))


@pytest.fixture(scope="module")
def env():
    environment = make()
    yield environment
    environment.close()


def raised(actor, height):
    pose = actor.pose.raw_pose.clone()
    pose[:, 2] += height
    return Pose.create(pose)


def leaves(tree, path=""):
    if isinstance(tree, dict):
        return {k: v for key, value in tree.items() for k, v in leaves(value, f"{path}/{key}").items()}
    return {path: tree}


def first_row(tree):
    return {key: first_row(value) if isinstance(value, dict) else value[0].numpy() for key, value in tree.items()}


def equal(a, b):
    a, b = leaves(a), leaves(b)
    return a.keys() == b.keys() and all(torch.equal(torch.nan_to_num(a[k]), torch.nan_to_num(b[k])) for k in a)


def test_the_card_describes_every_observation_and_every_info(env):
    obs, info = env.reset(seed=0)
    card = SelectiveGraspEnv.__doc__
    assert all(f"| {path[1:]} | ({_size(value)}" in card for path, value in leaves(obs).items())
    assert all(name in card for name in info if name not in ("elapsed_steps", "reconfigure"))
    space = env.unwrapped.single_observation_space
    assert all(np.isfinite([box.low, box.high]).all() for group in space.values() for box in _boxes(group))
    assert np.isfinite([env.unwrapped.single_action_space.low, env.unwrapped.single_action_space.high]).all()


def _size(value):
    named = {5: "n_classes", 21: "7 · K"}
    return named.get(value.shape[1], value.shape[1])


def _boxes(space):
    return [box for sub in space.values() for box in _boxes(sub)] if isinstance(space, gym.spaces.Dict) else [space]


# ------------------------------------------------------------------------------------------------------------ state


def some_steps(env, n, seed=0):
    rng = np.random.default_rng(seed)
    result = None
    for _ in range(n):
        action = HOME.copy()
        action[:6] += rng.uniform(-0.2, 0.2, 6)
        action[6] = rng.uniform(0.0, 0.14)
        result = env.step(action)
    return result


@pytest.mark.parametrize("flat", [False, True])
def test_a_state_comes_back_with_everything_that_the_task_remembers(env, flat):
    env.reset(seed=3)
    task = env.unwrapped
    some_steps(env, 5)
    task.memory.was_lifted[:] = True
    task.memory.dropped[:] = True
    before = task.get_state_dict()
    saved = task.get_state().clone() if flat else before
    first = [float(r[1]) for r in (some_steps(env, 1, seed=k) for k in range(3))]
    env.reset(seed=3)
    assert not equal(before, task.get_state_dict())
    if flat:
        task.set_state(saved)
    else:
        task.set_state_dict(saved)
    assert equal(before, task.get_state_dict())
    info = task.get_info()
    assert info["dropped"]
    assert int(info["elapsed_steps"]) == 5
    again = [float(r[1]) for r in (some_steps(env, 1, seed=k) for k in range(3))]
    assert again == pytest.approx(first, abs=1e-3)


def test_two_restorations_of_one_state_go_the_same_way(env):
    env.reset(seed=4)
    some_steps(env, 4)
    saved = env.unwrapped.get_state_dict()
    ends = []
    for _ in range(2):
        env.reset(seed=4)
        env.unwrapped.set_state_dict(saved)
        some_steps(env, 5, seed=1)
        ends.append(env.unwrapped.get_state_dict())
    assert equal(*ends)


def test_a_row_of_a_recorded_trajectory_is_a_state(env):
    env.reset(seed=4)
    some_steps(env, 4)
    saved = env.unwrapped.get_state_dict()
    env.reset(seed=4)
    env.unwrapped.set_state_dict(first_row(saved))
    assert equal(saved, env.unwrapped.get_state_dict())


def test_a_state_of_other_objects_is_refused(env):
    env.reset(seed=3)
    saved = env.unwrapped.get_state_dict()
    env.reset(seed=4)
    with pytest.raises(TaskError, match="other objects"):
        env.unwrapped.set_state_dict(saved)


@given(st.integers(0, 2**31 - 1), st.integers(1, 4), st.integers(1, 8), st.integers(0, 10**6))
def test_memory_survives_as_float32(noise_seed, n, k, seed):
    generator = torch.Generator().manual_seed(seed)
    memory = Memory.empty(torch.randint(0, 140, (n, k), generator=generator))
    everyone = torch.arange(n)
    start = torch.rand(n, k, 3, generator=generator)
    asked, air = torch.randint(0, k, (n,), generator=generator), torch.rand(n, k, generator=generator) * 0.1
    memory.begin(everyone, asked, start, air, torch.full((n,), noise_seed), torch.rand(n, generator=generator))
    memory.may_take[:] = torch.rand(n, k, generator=generator) > 0.5
    memory.note(start + 0.1, torch.rand(n, k, generator=generator) * 0.2, torch.rand(n, k, generator=generator) > 0.5)
    other = Memory.empty(memory.instances)
    state = memory.to_state()
    assert {value.dtype for value in state.values()} == {torch.float32}
    other.restore(state, everyone)
    assert equal(other.to_state(), state)
    assert torch.equal(other.noise_seed, memory.noise_seed)


# ------------------------------------------------------------------------------------------------------- pads, info


def test_forces_of_one_walk_are_those_of_many_queries(env):
    env.reset(seed=0)
    task = env.unwrapped
    slot = int(task.is_target[0].nonzero())
    actor = task.objects[slot]
    pose = actor.pose.raw_pose.clone()
    pose[:, :3] = task.agent.pads_pose.p
    actor._bodies[0].disable_gravity = True
    actor.set_pose(Pose.create(pose))  # hangs between the open pads, which then close
    closed = HOME.copy()
    closed[6] = 0.0
    held = []
    for _ in range(12):
        *_, info = env.step(closed)
        fast, directions = pad_forces(task.agent, task.objects), outward(task.agent.left_finger)
        for side, finger in enumerate((task.agent.left_finger, task.agent.right_finger)):
            slow = [task.scene.get_pairwise_contact_forces(finger, other) for other in task.objects]
            assert torch.allclose(fast[:, side, :-1], torch.stack(slow, dim=1), atol=1e-3)
            assert torch.allclose(fast[:, side, -1], finger.get_net_contact_forces(), atol=1e-3)
        reference = torch.stack([task.agent.is_grasping(other) for other in task.objects], dim=1)
        assert torch.equal(both_press(fast[:, :, :-1], directions), reference)
        assert torch.allclose(pads_centre(task.agent), task.agent.pads_pose.p, atol=1e-4)
        assert 0 <= float(squeeze(fast, directions)) <= gripper_linkage.FORCE_RANGE_N
        held.append(bool(info["target_held"]))
    assert any(held)


def test_two_things_between_the_pads_are_held_together_and_one_that_a_single_pad_touches_is_not():
    directions = torch.tensor([[[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]])  # outwards of the left and the right pad
    forces = torch.zeros(1, 2, 3, 3)
    forces[0, 0, 0, 1] = -5.0
    assert held_between(forces, directions).tolist() == [[False, False, False]]
    forces[0, 1, 2, 1] = 5.0
    assert held_between(forces, directions).tolist() == [[True, False, True]]
    assert both_press(forces, directions).tolist() == [[False, False, False]]
    forces[0, 1, 2] = torch.tensor([5.0, 0.0, 0.0])  # beside the pad
    assert held_between(forces, directions).tolist() == [[False, False, False]]


def test_disturbance_is_how_far_others_were_moved(env):
    env.reset(seed=1)
    task = env.unwrapped
    *_, info = env.step(HOME)
    assert float(info["disturbance_m"]) < 1e-3
    for slot in range(3):
        task.objects[slot].set_pose(raised(task.objects[slot], 0.03))
        expected = 0.0 if task.is_target[0, slot] else 0.03
        assert float(task.evaluate()["disturbance_m"]) == pytest.approx(expected, abs=2e-3)
        task.objects[slot].set_pose(raised(task.objects[slot], -0.03))


def test_a_planners_reason_is_in_info_until_the_next_episode(env):
    env.reset(seed=1)
    assert env.unwrapped.get_info()["planner_reason"] == [""]
    env.unwrapped.set_planner_reason("no finger fits between the objects")
    *_, info = env.step(HOME)
    assert info["planner_reason"] == ["no finger fits between the objects"]
    _, info = env.reset(seed=1)
    assert info["planner_reason"] == [""]


def test_either_twin_may_be_lifted_and_neither_is_the_wrong_one():
    environment = make(n_objects=4, same_class_twins=True)
    _, info = environment.reset(seed=0)
    task = environment.unwrapped
    twins = task.is_target[0].nonzero()[:, 0].tolist()
    assert [task.models[0][i].class_name for i in twins] == list(info["target"]) * 2
    for slot, actor in enumerate(task.objects):
        pose = actor.pose.raw_pose.clone()
        actor.set_pose(raised(actor, 0.2))
        assert bool(task.evaluate()["wrong_object"]) == (slot not in twins)
        actor.set_pose(Pose.create(pose))
    environment.close()


# ------------------------------------------------------------------------------------------------------- randomness


def test_friction_and_mass_are_drawn_from_their_limits():
    environment = make(friction=(0.3, 0.4), mass_scale=(1.5, 2.0))
    seen = []
    for seed in (0, 1, 0):
        environment.reset(seed=seed)
        task = environment.unwrapped
        bodies = [actor._bodies[0] for actor in task.objects]
        frictions = [body.collision_shapes[0].physical_material.static_friction for body in bodies]
        ratios = [body.mass / model.mass for body, model in zip(bodies, task.models[0], strict=True)]
        assert all(0.3 <= friction <= 0.4 for friction in frictions)
        assert all(1.5 <= ratio <= 2.001 for ratio in ratios)
        seen.append(frictions + ratios)
    assert seen[0] == seen[2] != seen[1]
    environment.close()


def test_light_is_drawn_for_each_scene():
    environment = make(light="random")

    def lamps(seed):
        environment.reset(seed=seed)
        parts = [part for entity in environment.unwrapped.scene.sub_scenes[0].entities for part in entity.components]
        return [(*part.color, *part.pose.q) for part in parts if isinstance(part, RenderDirectionalLightComponent)]

    first, other, again = (lamps(seed) for seed in (0, 1, 0))
    assert len(first) == 2
    assert first == again
    assert not np.allclose(first, other, atol=0.01)
    environment.close()


# ------------------------------------------------------------------------------------------------------------ cloud


def camera(n, height, width, focal):
    K = torch.eye(3).repeat(n, 1, 1)
    K[:, 0, 0] = K[:, 1, 1] = focal
    K[:, 0, 2], K[:, 1, 2] = width / 2, height / 2
    T = torch.eye(4).repeat(n, 1, 1)
    # Half a metre above (0.5, 0), looking down, x of the picture along -y of the base.
    T[:, :3, :3] = torch.tensor([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    T[:, :3, 3] = torch.tensor([0.5, 0.0, 0.5])
    return K, T


def test_a_cloud_has_its_size_and_lies_where_things_are():
    K, T = camera(3, 24, 32, 30.0)
    depth = torch.full((3, 24, 32), 0.5)  # the table
    depth[:, 10:14, 14:18] = 0.4  # a block of 16 pixels, 0.1 m high
    depth[1] = 0.0  # nothing measured
    seeds, steps = torch.tensor([1, 2, 3]), torch.tensor([0, 0, 5])
    cloud = sample_cloud(depth, K, T, seeds, steps, 64)
    assert cloud.shape == (3, 64, 3)
    assert torch.allclose(cloud[[0, 2], :, 2], torch.tensor(0.1), atol=1e-6)
    assert (cloud[1] == 0).all()
    assert len(torch.unique(cloud[0], dim=0)) == 16
    assert torch.allclose(cloud[0].unique(dim=0).mean(dim=0), torch.tensor([0.5, 0.0, 0.1]), atol=1e-3)


def test_a_row_of_a_cloud_does_not_depend_on_the_other_rows():
    K, T = camera(2, 24, 32, 30.0)
    depth = torch.rand(2, 24, 32) * 0.3 + 0.1
    seeds, steps = torch.tensor([5, 2**31 - 1]), torch.tensor([3, 4])
    both = sample_cloud(depth, K, T, seeds, steps, 50)
    alone = sample_cloud(depth[1:], K[1:], T[1:], seeds[1:], steps[1:], 50)
    later = sample_cloud(depth[1:], K[1:], T[1:], seeds[1:], steps[1:] + 1, 50)
    assert torch.equal(both[1:], alone)
    assert not torch.equal(alone, later)
    assert len(torch.unique(alone[0], dim=0)) == 50


def test_the_cloud_observation_shows_the_objects():
    environment = make(obs_mode="cloud", cloud_points=512, joint_noise=0.0)
    obs, _ = environment.reset(seed=2)
    again, _ = environment.reset(seed=2)
    cloud = obs["cloud"][0].numpy()
    assert environment.unwrapped.obs_mode == "cloud"
    assert obs.keys() == {"agent", "extra", "cloud"}
    assert cloud.shape == (512, 3)
    assert torch.equal(obs["cloud"], again["cloud"])
    assert (cloud >= np.float32(CLOUD_LOW)).all()
    assert (cloud <= np.float32(CLOUD_HIGH)).all()
    places = np.array([actor.pose.p[0, :2].numpy() for actor in environment.unwrapped.objects])
    low = cloud[cloud[:, 2] < 0.1]  # what is higher belongs to the hand
    distance = np.linalg.norm(low[:, None, :2] - places, axis=2)
    assert (distance.min(axis=1) < 0.15).all()
    assert len(np.unique(distance.argmin(axis=1))) == 3
    environment.close()


# ----------------------------------------------------------------------------------------------------------- reward


def moment(distance=0.3, held=False, air=0.0, speed=0.0, wrong=False, success=False, fail=False):
    flags = {"target_held": held, "wrong_held": wrong, "success": success, "fail": fail}
    numbers = {"target_distance": distance, "target_air": air, "target_speed": speed}
    return {name: torch.tensor([value]) for name, value in (flags | numbers).items()}


def test_each_term_of_the_potential_rises_with_progress():
    ladder = [
        moment(0.5),
        moment(0.1),
        moment(0.02),
        moment(0.02, held=True),
        moment(0.02, held=True, air=0.05),
        moment(0.02, held=True, air=LIFT_HEIGHT, speed=0.5),
        moment(0.02, held=True, air=LIFT_HEIGHT),
    ]
    values = [float(potential(info)) for info in ladder]
    assert values == sorted(values)
    assert len(set(values)) == len(values)
    assert float(potential(moment(0.02, wrong=True))) < float(potential(moment(0.02)))
    assert values[0] >= 0
    assert values[-1] <= 4


@given(st.lists(st.tuples(st.floats(0, 1), st.booleans(), st.floats(0, 0.3), st.booleans()), min_size=2, max_size=20))
def test_whatever_is_done_between_two_moments_pays_the_same(path):
    values = [potential(moment(d, held, air, wrong=wrong)) for d, held, air, wrong in path]
    paid = sum(float(reward(a, b, moment())) for a, b in pairwise(values))
    assert paid == pytest.approx(float(values[-1] - values[0]), abs=1e-4)


def test_success_and_failure_end_with_their_own_reward():
    zero = torch.zeros(1)
    assert float(reward(zero, zero + 0.1, moment(success=True))) == 5.0
    assert float(reward(zero, zero, moment(fail=True))) == -1.0
