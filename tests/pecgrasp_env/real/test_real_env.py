"""SelectiveGraspReal-v1 through real sockets: the simulation's spaces and actions, and nothing moves without a yes."""

import subprocess
import sys
import time
import warnings

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from scipy.spatial.transform import Rotation

pytest.importorskip("rtde_control", reason="pip install 'pecgrasp[ur]'")

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.envs.real_actions import OutOfReach, joint_targets
from pecgrasp_env.envs.real_robot import RealRobot, RealTaskError, SelectiveGraspRealEnv
from pecgrasp_env.real import Declined, ProtectiveStop, RobotiqGripper
from pecgrasp_env.real.connected import SettingError
from pecgrasp_env.real.fakes.bench import BenchCamera
from pecgrasp_env.real.ur import URArm
from pecgrasp_env.robot.kinematics import HOME, T_TOOL0_TCP, forward_kinematics

PATIENCE_S = 60.0
TARGET = "plug_adapter"
SIMULATION = {"render_backend": "cpu", "n_objects": 1, "classes": [TARGET], "objects": {"instances_per_class": 1}}
MODES = ("pd_joint_pos", "pd_joint_delta_pos", "pd_ee_pose", "pd_ee_delta_pose")


@pytest.fixture
def robot(scene_bench):
    scene_bench.ask(reset=1)
    host = scene_bench.host
    robot = RealRobot(URArm(host, patience=PATIENCE_S), RobotiqGripper(host), BenchCamera(host))
    yield robot
    for each in (robot.arm, robot.gripper, robot.camera):
        each.close()


def make(robot, **kwargs):
    arguments = {"classes": [TARGET], "confirm": "no"} | kwargs
    return gym.make("SelectiveGraspReal-v1", robot=robot, **arguments)


def test_spaces_are_those_of_the_simulation(robot):
    for obs_mode in ("depth", "cloud"):
        simulated = gym.make("SelectiveGraspSingle-v1", obs_mode=obs_mode, **SIMULATION)
        real = make(robot, obs_mode=obs_mode)
        assert real.observation_space == simulated.observation_space
        assert real.action_space == simulated.action_space
        simulated.close()


@pytest.mark.slow
def test_actions_lead_where_the_simulations_controllers_go(robot):
    rng = np.random.default_rng(0)
    for mode in MODES:
        simulated = gym.make("SelectiveGraspSingle-v1", obs_mode="state", control_mode=mode, **SIMULATION)
        assert make(robot, control_mode=mode).action_space == simulated.action_space
        simulated.reset(seed=0)
        agent = simulated.unwrapped.task.agent
        q = agent.robot.get_qpos()[0, :6].numpy().astype(float)
        T = forward_kinematics(q) @ T_TOOL0_TCP
        for _ in range(3):
            action = rng.uniform(-0.5, 0.5, 8)
            if mode == "pd_joint_pos":
                action[:6] += q
            elif mode == "pd_ee_pose":
                turned = Rotation.from_matrix(T[:3, :3]) * Rotation.from_rotvec(0.1 * action[3:6])
                action[:6] = [*(T[:3, 3] + 0.05 * action[:3]), *turned.as_euler("XYZ")]
            agent.set_action(torch.tensor(action[None], dtype=torch.float32))
            theirs = agent.controller.controllers["arm"]._target_qpos[0].numpy()
            assert joint_targets(mode, action[:6], q) == pytest.approx(theirs, abs=5e-3), mode
        simulated.close()


def test_gymnasium_finds_nothing_wrong_with_it(robot):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*render.*")
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        env = SelectiveGraspRealEnv(robot, classes=[TARGET], confirm="no")
        env.spec = gym.spec("SelectiveGraspReal-v1")  # which says that twice the same is not equal on a robot
        check_env(env, skip_render_check=True, skip_close_check=True)


def test_an_episode_sees_what_the_robot_does(robot, scene_bench):
    env = make(robot, control_mode="pd_joint_pos")
    obs, info = env.reset(seed=3)
    assert info["target"] == TARGET
    assert obs["agent"]["qpos"][:6] == pytest.approx(HOME, abs=0.01)
    assert obs["sensor_data"]["wrist_camera"]["depth"].max() > 0.4
    there = HOME + 0.1 * np.eye(6)[0]
    for _ in range(8):
        obs, reward, terminated, truncated, info = env.step(np.array([*there, 0.06, 40.0], np.float32))
        assert obs in env.observation_space
        assert (reward, terminated, truncated, info["refused"]) == (0.0, False, False, "")
    assert obs["agent"]["qpos"][:6] == pytest.approx(there, abs=0.02)
    tcp = forward_kinematics(obs["agent"]["qpos"][:6].astype(float)) @ T_TOOL0_TCP
    assert obs["extra"]["tcp_pose"][:3] == pytest.approx(tcp[:3, 3], abs=1e-5)
    assert scene_bench.state["q"] == pytest.approx(there, abs=0.02)
    deadline = time.monotonic() + PATIENCE_S
    while env.step(np.array([*there, 0.06, 40.0], np.float32))[0]["extra"]["opening"][0] > 0.07:
        assert time.monotonic() < deadline


def test_a_target_outside_of_the_workspace_is_refused_and_the_episode_goes_on(robot, scene_bench):
    env = make(robot, control_mode="pd_ee_pose")
    env.reset()
    pose = [0.4, 0.0, -0.2, np.pi, 0.0, 0.0, 0.14, 20.0]
    *_, truncated, info = env.step(np.array(pose, np.float32))
    assert not truncated
    assert "table" in info["refused"] or "outside" in info["refused"]
    pose[:3] = 1.9, 1.9, 1.9
    assert "no posture of the arm" in env.step(np.array(pose, np.float32))[-1]["refused"]
    assert scene_bench.state["q"] == pytest.approx(HOME, abs=0.01)


def test_nothing_moves_at_a_reset_without_a_yes(robot, scene_bench):
    away = HOME + 0.2 * np.eye(6)[0]
    robot.arm.move_joints(away).wait(PATIENCE_S)
    asked = []
    env = make(robot, confirm="each", ask=lambda doing: bool(asked.append(doing)))
    with pytest.raises(Declined, match="move to the home posture"):
        env.reset()
    assert asked == ["move to the home posture"]
    assert scene_bench.state["q"] == pytest.approx(away, abs=0.005)
    with pytest.raises(SettingError, match="confirm=perhaps"):
        make(robot, confirm="perhaps")


def test_a_protective_stop_ends_the_episode_and_a_yes_is_needed_to_go_on(robot, scene_bench):
    answers = {"make the arm ready": False, "move to the home": True, "open the gripper": True}
    env = make(robot, confirm="each", ask=lambda doing: next(yes for words, yes in answers.items() if words in doing))
    env.reset()
    scene_bench.provoke("protective_stop")
    deadline, truncated = time.monotonic() + PATIENCE_S, False
    while not truncated:
        assert time.monotonic() < deadline
        *_, truncated, info = env.step(np.zeros(8, np.float32))
    assert info["error"] == "ProtectiveStop"
    assert "look what it touches" in info["reason"]
    with pytest.raises(ProtectiveStop):
        env.step(np.zeros(8, np.float32))
    with pytest.raises(Declined, match="not made ready"):
        env.reset()
    scene_bench.provoke("none")
    answers["make the arm ready"] = True
    env.reset()
    assert not env.step(np.zeros(8, np.float32))[3]


def test_what_makes_no_sense_is_named(robot):
    with pytest.raises(RealTaskError, match="RealRobot"):
        make("ur5")
    with pytest.raises(RealTaskError, match="only a simulation knows where the objects are"):
        make(robot, obs_mode="state")
    env = make(robot)
    with pytest.raises(RealTaskError, match="target='fork'"):
        env.reset(options={"target": "fork"})
    with pytest.raises(OutOfReach, match="joint 1 to 9"):
        joint_targets("pd_joint_pos", np.array([9.0, 0, 0, 0, 0, 0]), HOME)


def test_it_needs_no_simulator():
    program = "import sys, pecgrasp_env.envs.real_robot; print(sorted({'sapien', 'mani_skill'} & set(sys.modules)))"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert ended.stdout.strip() == "[]", ended.stderr
