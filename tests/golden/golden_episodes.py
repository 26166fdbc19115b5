"""Golden items of the simulation: episodes of the scripted policy, and the modes of observation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from golden_digest import Values, digest

from pecgrasp_env import ScriptedPolicy
from pecgrasp_env.evaluation import run_episode
from pecgrasp_env.objects import LARS_CLASSES, Catalogue
from pecgrasp_env.robot import T_TOOL0_CAMERA, forward_kinematics


class TrueLabels:
    """Stands for a perfect classifier: the class of the object nearest to the cloud."""

    def __init__(self, task: Any) -> None:
        self.task = task

    def __call__(self, points: np.ndarray) -> tuple[str, float]:
        q = self.task.agent.robot.get_qpos()[0, :6].numpy().astype(float)
        T = forward_kinematics(q) @ T_TOOL0_CAMERA
        centre = (points @ T[:3, :3].T + T[:3, 3]).mean(axis=0)[:2]
        places = [actor.pose.p[0, :2].numpy() for actor in self.task.objects]
        nearest = int(np.argmin([np.linalg.norm(place - centre) for place in places]))
        return self.task.models[0][nearest].class_name, 0.99


class Looked(Mapping[str, Any]):
    """A camera's pictures, and a digest of each that somebody looked at."""

    def __init__(self, pictures: Mapping[str, Any], notes: list[str]) -> None:
        self.pictures = pictures
        self.notes = notes

    def __getitem__(self, kind: str) -> Any:
        picture = self.pictures[kind]
        self.notes.append(f"{kind} {digest(picture)}")
        return picture

    def __contains__(self, kind: object) -> bool:
        return kind in self.pictures  # the mixin's would take the picture

    def __iter__(self) -> Iterator[str]:
        return iter(self.pictures)

    def __len__(self) -> int:
        return len(self.pictures)


def with_coarse_forces(told: Mapping[str, Any]) -> dict[str, Any]:
    """Grip forces to 0.1 N: their last bits differ by run, as if contacts were added up in any order."""
    return {name: value.round(decimals=1) if name in ("force", "grip_force") else value for name, value in told.items()}


class Recorder(gym.Wrapper):
    """Draws pictures only when they are looked at, and notes these, the state, actions, rewards and info."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        env.unwrapped.pictures_on_demand = True
        self.notes: list[str] = []

    def reset(self, **choices: Any) -> tuple[Any, dict[str, Any]]:
        obs, info = self.env.reset(**choices)
        return self.noted(obs, info, []), info

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        obs, reward, terminated, truncated, info = self.env.step(action)
        obs = self.noted(obs, info, [action, reward, terminated, truncated])
        return obs, reward, terminated, truncated, info

    def noted(self, obs: dict[str, Any], info: dict[str, Any], action_and_reward: list[Any]) -> dict[str, Any]:
        """The observation, of which everything is noted now, and a picture once it is looked at."""
        state = {name: value for name, value in obs.items() if name != "sensor_data"}
        state["extra"] = with_coarse_forces(state["extra"])
        self.notes.append(digest([state, action_and_reward, with_coarse_forces(info)]))
        cameras = {name: Looked(pictures, self.notes) for name, pictures in obs["sensor_data"].items()}
        return {**obs, "sensor_data": cameras}

    def recorded(self) -> list[str]:
        """What was noted since this was last asked."""
        notes, self.notes = self.notes, []
        return notes


def episodes(clutter: str) -> Values:
    """Every step of 20 episodes of the scripted policy: state, reward, info, and the pictures that it looked at."""
    env = Recorder(
        gym.make(
            "SelectiveGrasp-v1",
            obs_mode="depth",
            reward_mode="dense",
            control_mode="pd_joint_pos",
            sim_backend="physx_cpu",
            render_backend="cpu",
            clutter=clutter,
            sensor="d435",
            objects=Catalogue(LARS_CLASSES, instances_per_class=2),
        )
    )
    policy, outcomes = ScriptedPolicy(TrueLabels(env.unwrapped)), Counter[str]()
    for seed in range(20):
        episode = run_episode(env, policy, seed)
        outcomes[episode.outcome] += 1
        told = {name: value for name, value in vars(episode).items() if name != "stages"}
        log = policy.log
        force = None if log.held_n is None else round(log.held_n, 1)
        yield f"{clutter} {seed:02d}", [env.recorded(), told, log.grasp, log.plan, log.objects, log.held_m, force]
    env.close()
    print(f"    {clutter}: {dict(outcomes)}")


def observations() -> Values:
    """A few steps at random in the other modes of observation, and by the unbatched task."""
    modes = [("SelectiveGrasp-v1", mode) for mode in ("state", "state_dict", "cloud", "rgb+depth+segmentation")]
    for task, mode in [*modes, ("SelectiveGraspSingle-v1", "cloud")]:
        env = gym.make(task, obs_mode=mode, sensor="d435", light="random", n_objects=2, render_backend="cpu")
        env.action_space.seed(0)
        steps: list[Any] = [env.reset(seed=5)]
        steps += [env.step(env.action_space.sample()) for _ in range(5)]
        yield f"{task} {mode}", steps
        env.close()
