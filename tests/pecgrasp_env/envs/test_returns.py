"""What the dense reward pays in all: the expert against those who do nothing, push, or hold the wrong object."""

import gymnasium as gym
import numpy as np
import pytest

from pecgrasp_env import ScriptedPolicy
from pecgrasp_env.objects import LARS_CLASSES, Catalogue
from pecgrasp_env.robot import UR5Robotiq2F140

HOME = np.array([*UR5Robotiq2F140.keyframes["home"].qpos[:6], 0.14, 60.0], np.float32)
STEPS = 120


def rollout(env, seed, who, labels):
    """The return of an episode of at most STEPS steps, and its last info."""
    obs, info = env.reset(seed=seed)
    target, task = info["target"][0], env.unwrapped
    other = next(model.class_name for model in task.models[0] if model.class_name != target)
    policy = ScriptedPolicy(labels(task, {target: other, other: target} if who == "holds the wrong one" else None))
    policy.reset(target)
    paid, action = 0.0, HOME
    for _ in range(STEPS):
        if who != "idles" and not (who == "holds the wrong one" and info["wrong_held"]):
            action = policy.act(obs).copy()
            if who == "pushes":
                action[6] = 0.0  # a closed hand
        obs, reward, terminated, _, info = env.step(action)
        paid += float(reward)
        if terminated:
            break
    return paid, info


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4])
def test_the_expert_earns_more_than_those_who_do_not_do_the_task(seed, labels):
    env = gym.make(
        "SelectiveGrasp-v1",
        obs_mode="depth",
        reward_mode="dense",
        control_mode="pd_joint_pos",
        sim_backend="physx_cpu",
        render_backend="cpu",
        objects=Catalogue(LARS_CLASSES, instances_per_class=2),
    )
    paid = {}
    for who in ("expert", "idles", "pushes", "holds the wrong one"):
        paid[who], info = rollout(env, seed, who, labels)
        assert bool(info["success"]) == (who == "expert")
        if who == "holds the wrong one":
            assert info["wrong_held"]
    env.close()
    assert paid["expert"] > 5
    assert paid["idles"] == pytest.approx(0.0, abs=0.05)
    assert paid["pushes"] < 1
    assert paid["holds the wrong one"] < 0
