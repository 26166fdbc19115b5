"""The same movement in every control mode: posture, opening and force limit that joint targets ask for."""

import gymnasium as gym
import numpy as np
import pytest

import pecgrasp_env  # noqa: F401  (registers the task)
from pecgrasp_env.learning.control_modes import CONTROL_MODES, from_joint_targets, to_joint_targets
from pecgrasp_env.robot.agent import UR5Robotiq2F140
from pecgrasp_env.robot.kinematics import HOME


@pytest.fixture(scope="module", params=CONTROL_MODES)
def env(request):
    options = {"render_backend": "none", "sim_backend": "physx_cpu", "n_objects": 1, "joint_noise": 0.0}
    environment = gym.make("SelectiveGrasp-v1", control_mode=request.param, **options)
    yield environment
    environment.close()


def test_the_control_modes_are_the_robots(env):
    assert set(CONTROL_MODES) == set(env.unwrapped.agent._controller_configs)
    assert UR5Robotiq2F140.uid == env.unwrapped.agent.uid


@pytest.mark.parametrize("reach", [0.02, 0.25])
def test_joint_targets_are_reached_in_any_mode(env, reach):
    """0.25 rad take several steps where a step is 0.1 rad."""
    env.reset(seed=0)
    agent = env.unwrapped.agent
    targets = np.array([*(HOME + reach * np.array([1, -1, 0.5, 1, -1, 1])), 0.08, 40.0])
    for _ in range(12):
        action = from_joint_targets(agent, targets)
        assert env.unwrapped.single_action_space.contains(action)
        env.step(action)
    assert np.allclose(agent.robot.get_qpos()[0, :6], targets[:6], atol=2e-3)
    assert float(agent.gripper_opening[0]) == pytest.approx(0.08, abs=1e-3)
    assert float(agent.controller.controllers["gripper"].get_state()["force_limit"][0]) == pytest.approx(40.0, abs=0.01)


def test_joint_steps_are_joint_targets_from_where_the_arm_is(env):
    env.reset(seed=0)
    agent = env.unwrapped.agent
    targets = to_joint_targets(agent, "pd_joint_delta_pos", np.array([0.5, 0, 0, -2.0, 0, 0, 1.0, -1.0]))
    q = agent.robot.get_qpos()[0, :6].numpy()
    assert np.allclose(targets, [q[0] + 0.05, q[1], q[2], q[3] - 0.1, q[4], q[5], 0.14, 10.0], atol=1e-6)
    assert np.array_equal(to_joint_targets(agent, "pd_joint_pos", targets), targets)


def test_the_answer_stays_in_every_mode(env):
    """The ninth number of a task in which the asked-for class may be absent."""
    env.reset(seed=0)
    agent = env.unwrapped.agent
    targets = np.array([*HOME, 0.08, 40.0])
    plain, answering = from_joint_targets(agent, targets), from_joint_targets(agent, np.append(targets, 1.0))
    assert np.array_equal(answering, [*plain, 1.0])
    assert to_joint_targets(agent, "pd_joint_delta_pos", np.zeros(9)).shape == (9,)
