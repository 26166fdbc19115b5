"""SelectiveGrasp-v1: spaces, seeds, the start, what counts as success and as failure, rewards, arguments."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
import torch
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.envs.selective_grasp import SelectiveGraspEnv, TaskError
from pecgrasp_env.objects import LARS_CLASSES, Catalogue, ObjectError
from pecgrasp_env.robot import UR5Robotiq2F140
from pecgrasp_env.scene.placement import REGION, PlacementError
from pecgrasp_env.sensor import SensorError

SOURCE = Catalogue(LARS_CLASSES, instances_per_class=2)
HOME = np.array([*UR5Robotiq2F140.keyframes["home"].qpos[:6], 0.14, 60.0], np.float32)


def make(**kwargs):
    defaults = {
        "obs_mode": "state_dict",
        "control_mode": "pd_joint_pos",
        "sim_backend": "physx_cpu",
        "render_backend": "cpu",
        "objects": SOURCE,
    }
    return gym.make("SelectiveGrasp-v1", **(defaults | kwargs))


@pytest.fixture(scope="module")
def env():
    environment = make(reward_mode="dense")
    yield environment
    environment.close()


def flat(value):
    """All leaves of nested observations and infos, as arrays by path."""
    if isinstance(value, tuple):
        value = dict(enumerate(value))
    if isinstance(value, dict):
        return {f"{k}/{path}": leaf for k, v in value.items() for path, leaf in flat(v).items()}
    return {"": np.asarray(value)}


def same(a, b):
    a, b = flat(a), flat(b)
    return a.keys() == b.keys() and all(np.array_equal(a[k], b[k]) for k in a)


# ------------------------------------------------------------------------------------------------------ contract


def test_import_registers_and_loads_nothing_heavy():
    code = (
        "import sys, pecgrasp_env, gymnasium; gymnasium.spec('SelectiveGrasp-v1');"
        "print([m for m in ('torch', 'sapien', 'mani_skill', 'scipy') if m in sys.modules])"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_the_docstring_is_a_card():
    headings = [line.strip()[3:] for line in SelectiveGraspEnv.__doc__.splitlines() if line.strip().startswith("## ")]
    assert headings == [
        "Description",
        "Action Space",
        "Observation Space",
        "Rewards",
        "Starting State",
        "Episode End",
        "Arguments",
        "Version History",
    ]


@pytest.mark.parametrize(
    ("obs_mode", "present", "absent"),
    [
        ("state_dict", ["extra/target_pose/", "extra/object_poses/"], ["sensor_data"]),
        ("depth+segmentation", ["sensor_data/wrist_camera/depth/", "extra/target/"], ["extra/target_pose/", "rgb"]),
        ("rgb+depth", ["sensor_data/wrist_camera/rgb/", "sensor_data/wrist_camera/depth/"], ["extra/object_poses/"]),
        ("pointcloud", ["pointcloud/xyzw/", "pointcloud/rgb/", "extra/opening/"], ["extra/target_pose/"]),
    ],
)
def test_observations_lie_in_their_space(obs_mode, present, absent):
    environment = make(obs_mode=obs_mode)
    obs, _ = environment.reset(seed=1)
    leaves, space = flat(obs), environment.observation_space
    assert space.contains(_numpy(obs))
    assert all(key in leaves for key in present)
    assert not any(text in key for key in leaves for text in absent)
    assert leaves["extra/target/"].sum() == 1
    environment.close()


def _numpy(obs):
    return {k: _numpy(v) if isinstance(v, dict) else v.numpy() for k, v in obs.items()}


@pytest.mark.parametrize("robot", [UR5Robotiq2F140, (UR5Robotiq2F140.uid,)])
def test_all_classes_of_an_opened_source_may_lie_there(robot):
    source = Catalogue(("bowl", "can"), instances_per_class=1)
    environment = make(objects=source, n_objects=2, robot_uids=robot, render_backend=None)
    assert environment.unwrapped.classes == ("bowl", "can")
    environment.close()


def test_the_flat_state_is_one_vector():
    environment = make(obs_mode="state")
    obs, _ = environment.reset(seed=1)
    assert environment.observation_space.contains(obs.numpy())
    assert obs.ndim == 2
    environment.close()


def test_unbatched_it_is_a_plain_gymnasium_environment():
    environment = CPUGymWrapper(make(obs_mode="state", reward_mode="normalized_dense"))
    obs, info = environment.reset(seed=1)
    assert environment.observation_space.contains(obs)
    assert info["target"] in LARS_CLASSES
    obs, reward, terminated, truncated, info = environment.step(environment.action_space.sample())
    assert environment.observation_space.contains(obs)
    assert -1.2 <= float(reward) <= 1.0
    assert not terminated
    assert not truncated
    environment.close()
    environment.close()


def test_truncation_after_the_given_steps():
    environment = make(max_episode_steps=3)
    environment.reset(seed=0)
    ends = [bool(environment.step(HOME)[3]) for _ in range(3)]
    assert ends == [False, False, True]
    environment.close()


@pytest.mark.parametrize(
    ("control_mode", "low", "high"),
    [("pd_joint_pos", 10, 125), ("pd_joint_delta_pos", -1, 1), ("pd_ee_pose", 10, 125), ("pd_ee_delta_pose", -1, 1)],
)
def test_every_control_mode_has_eight_numbers(control_mode, low, high):
    environment = make(control_mode=control_mode)
    space = environment.unwrapped.single_action_space
    assert space.shape == (8,)
    assert (space.low[7], space.high[7]) == (low, high)
    environment.close()


# --------------------------------------------------------------------------------------------------------- camera


def test_depth_is_in_metres_and_exact():
    environment = make(obs_mode="depth", joint_noise=0.0)
    obs, _ = environment.reset(seed=0)
    depth = obs["sensor_data"]["wrist_camera"]["depth"][0, ..., 0].numpy()
    height = float(obs["sensor_param"]["wrist_camera"]["cam2world_gl"][0, 2, 3])
    assert depth.dtype == np.float32
    assert np.median(depth) == pytest.approx(height, abs=1e-4)
    environment.close()


def test_the_cloud_lies_on_the_table_in_the_world_frame():
    environment = make(obs_mode="pointcloud")
    obs, _ = environment.reset(seed=0)
    cloud = obs["pointcloud"]["xyzw"][0].numpy()
    x, _, z, valid = cloud.T
    table = (valid == 1) & (np.abs(z) < 0.002)
    assert table.mean() > 0.8
    assert np.abs(z[table]).mean() < 1e-4
    assert x[table].min() < 0.3
    assert x[table].max() > 0.7
    assert set(np.unique(valid)) <= {0.0, 1.0}
    environment.close()


def test_the_d435_has_faults_that_the_seed_fixes():
    ideal, faulty = make(obs_mode="depth"), make(obs_mode="depth", sensor="d435")
    pictures = [
        e.reset(seed=5)[0]["sensor_data"]["wrist_camera"]["depth"][0, ..., 0].numpy() for e in (ideal, faulty, faulty)
    ]
    assert np.array_equal(pictures[1], pictures[2])
    both = (pictures[0] > 0) & (pictures[1] > 0)
    error = np.abs(pictures[1] - pictures[0])[both]
    assert 1e-4 < np.median(error) < 0.01
    assert (pictures[1] == 0).sum() > (pictures[0] == 0).sum()
    assert not np.array_equal(pictures[1], faulty.step(HOME)[0]["sensor_data"]["wrist_camera"]["depth"][0, ..., 0])
    ideal.close()
    faulty.close()


# ----------------------------------------------------------------------------------------------------- start, seeds


def test_a_seed_fixes_the_episode_whatever_came_before(env):
    first = env.reset(seed=3)
    env.reset(seed=4)
    env.step(HOME)
    again = env.reset(seed=3)
    other = env.reset(seed=4)
    assert same(first, again)
    assert not same(first[0], other[0])


def test_twins_with_one_seed_stay_equal():
    twins = [make(reward_mode="dense"), make(reward_mode="dense")]
    rng = np.random.default_rng(0)
    assert same(*(twin.reset(seed=11) for twin in twins))
    for _ in range(40):
        action = HOME + rng.normal(scale=0.3, size=8).astype(np.float32)
        assert same(*(twin.step(action) for twin in twins))
    for twin in twins:
        twin.close()


@pytest.mark.parametrize("seed", range(4))
def test_objects_start_at_rest_apart_and_of_different_classes(env, seed):
    obs, info = env.reset(seed=seed)
    task = env.unwrapped
    classes = [model.class_name for model in task.models[0]]
    assert len(set(classes)) == 3
    assert info["target"][0] in classes
    before = obs["extra"]["object_poses"].reshape(3, 7).clone()
    assert (before[:, 0] > REGION.x_min).all()
    assert (before[:, 0] < REGION.x_max).all()
    assert (before[:, 1].abs() < REGION.y_max).all()
    pairs = [(a, b) for i, a in enumerate(task.objects) for b in task.objects[:i]]
    for _ in range(20):
        obs, _, _, _, info = env.step(HOME)
        assert all(float(task.scene.get_pairwise_contact_forces(a, b).norm()) == 0.0 for a, b in pairs)
    assert torch.linalg.norm(obs["extra"]["object_poses"].reshape(3, 7)[:, :3] - before[:, :3], dim=1).max() < 1e-3
    assert not info["success"]
    assert not info["fail"]


@pytest.mark.slow
def test_neither_class_nor_number_tells_the_target(env):
    """The asked-for object is drawn among all classes, and takes any number in the segmentation picture."""
    targets, slots = set(), set()
    for seed in range(16):
        _, info = env.reset(seed=seed)
        targets.add(info["target"][0])
        slots.add(int(env.unwrapped.is_target[0].nonzero()))
    assert targets == set(LARS_CLASSES)
    assert slots == {0, 1, 2}


def test_without_a_seed_episodes_differ(env):
    env.reset(seed=0)
    first, second = (env.reset()[0] for _ in range(2))
    assert not same(first, second)


def test_objects_stay_where_reconfiguration_is_off_and_are_laid_out_anew():
    environment = make(reconfiguration_freq=0)
    names, poses = [], []
    for seed in (1, 2):
        obs, _ = environment.reset(seed=seed)
        names.append([model.instance for model in environment.unwrapped.models[0]])
        poses.append(obs["extra"]["object_poses"].numpy())
    assert names[0] == names[1]
    assert not np.allclose(poses[0], poses[1])
    environment.close()


# ----------------------------------------------------------------------------------------------- outcomes, rewards


def test_an_object_pushed_off_the_table_is_a_failure(env):
    env.reset(seed=2)
    victim = env.unwrapped.objects[0]
    rewards = []
    for _ in range(60):
        victim.set_linear_velocity(torch.tensor([[0.0, 1.5, 0.0]]))
        _, reward, terminated, _, info = env.step(HOME)
        rewards.append(float(reward))
        if terminated:
            break
    assert info["off_table"]
    assert info["fail"]
    assert not info["success"]
    assert not info["wrong_object"]
    assert rewards[-1] < rewards[0] - 0.9


def test_an_object_in_the_air_that_nobody_holds_is_no_success(env):
    """Thrown up, it passes every height; and another one in the air is the wrong one."""
    env.reset(seed=2)
    task = env.unwrapped
    slot = int(task.is_target[0].nonzero())
    for thrown, wrong in ((slot, False), ((slot + 1) % 3, True)):
        env.reset(seed=2)
        task.objects[thrown].set_linear_velocity(torch.tensor([[0.0, 0.0, 2.5]]))
        seen = []
        for _ in range(12):
            *_, info = env.step(HOME)
            seen.append((bool(info["success"]), bool(info["wrong_object"])))
        assert not any(success for success, _ in seen)
        assert any(failure for _, failure in seen) == wrong


def test_dense_rewards_keep_their_bounds(env):
    rng = np.random.default_rng(1)
    env.reset(seed=6)
    space = env.unwrapped.single_action_space
    for _ in range(60):
        action = rng.uniform(space.low, space.high).astype(np.float32)
        action[:6] = HOME[:6] + rng.uniform(-0.8, 0.8, 6)
        _, reward, terminated, _, _ = env.step(action)
        assert -6.0 <= float(reward) <= 5.0
        if terminated:
            env.reset()


# -------------------------------------------------------------------------------------------------------- arguments


@pytest.mark.parametrize(
    ("kwargs", "error", "words"),
    [
        ({"n_objects": 0}, TaskError, "n_objects=0"),
        ({"n_objects": 9}, TaskError, "n_objects=9.*'apart'.*'piled' 15"),
        ({"n_objects": 16, "clutter": "bin"}, TaskError, "n_objects=16.*1 and 15"),
        ({"n_objects": 1, "same_class_twins": True}, TaskError, "n_objects=1"),
        ({"n_objects": 2, "classes": ("mouse",)}, TaskError, "n_objects=2"),
        ({"clutter": "messy"}, TaskError, "clutter='messy'"),
        ({"sensor": "kinect"}, TaskError, "sensor='kinect'"),
        ({"resolution": "100x100"}, SensorError, "100x100"),
        ({"clearance": -0.1}, TaskError, "clearance=-0.1"),
        ({"joint_noise": -1.0}, TaskError, "joint_noise=-1.0"),
        ({"clearance": float("nan")}, TaskError, "clearance=nan"),
        ({"friction": 0.5}, TaskError, "friction=0.5"),
        ({"classes": ("mouse", "mouse")}, TaskError, "classes"),
        ({"classes": ("mouse", "can"), "n_objects": 1}, TaskError, "can"),
        ({"classes": ("mouse", "unicorn"), "n_objects": 1, "objects": None}, ObjectError, "unicorn"),
        ({"clearance": 0.6}, PlacementError, "clearance=0.6"),
        ({"n_object": 2}, TypeError, "n_object=2.*mean n_objects"),
        ({"control_freq": 10}, TypeError, "sim_config"),
        ({"robot_uids": "panda"}, TaskError, "robot_uids='panda'.*ur5_robotiq_2f140"),
        ({"sim_backend": "mujoco"}, TaskError, "sim_backend='mujoco'.*physx_cpu"),
        ({"num_envs": 0}, TaskError, "num_envs=0"),
        ({"obs_mode": "depth+smell"}, TaskError, "depth.smell.*pointcloud, cloud.*rgb, depth"),
        ({"obs_mode": "depth", "render_backend": "none"}, TaskError, "needs a renderer"),
        ({"render_mode": "film"}, TaskError, "render_mode='film'.*rgb_array"),
        ({"reward_mode": "film"}, TaskError, "reward_mode='film'.*dense"),
        ({"reconfiguration_freq": -1}, TaskError, "reconfiguration_freq=-1"),
        ({"parallel_in_single_scene": True}, TaskError, "parallel_in_single_scene"),
        ({"sensor_configs": {"base_camera": {"width": 8}}}, TaskError, "base_camera.*wrist_camera"),
        ({"sensor_configs": {"widht": 8}}, SensorError, "widht=8"),
        ({"objects": {"classes": ["can"]}}, TaskError, "classes are said beside it"),
        ({"objects": Catalogue(("can",), 1)}, TaskError, "n_objects=3.*n_objects=1"),
        ({"classes": ("can",), "n_objects": 1}, TaskError, "no class can, they have joypad"),
    ],
)
def test_arguments_that_make_no_sense_are_named(kwargs, error, words):
    with pytest.raises(error, match=words):
        make(**kwargs)
