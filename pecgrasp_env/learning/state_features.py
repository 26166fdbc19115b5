"""What an agent that learns from the state sees: where the arm, the gripper and the asked-for object are."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np
import torch
from mani_skill.trajectory.dataset import load_h5_data
from mani_skill.trajectory.utils import index_dict
from scipy.spatial.transform import Rotation

from pecgrasp_env.robot.kinematics import T_TOOL0_TCP, forward_kinematics

CONTROL_MODE = "pd_joint_pos"
_HELD_N = 2.0  # grip force from which the object moves with the hand


class MomentsError(ValueError):
    """The demonstrations cannot be learnt from; the message says why."""


@dataclass(frozen=True)
class Moments:
    """What is seen at N moments: q (N, 6) rad; gripper (N, 3), the opening it goes to and the one it has, m, and its
    force, N; T_world_thing (N, 4, 4) of the asked-for object.
    """

    q: np.ndarray
    gripper: np.ndarray
    T_world_thing: np.ndarray

    @classmethod
    def of(cls, obs: Mapping[str, Any]) -> Moments:
        """Of an observation of the mode `state_dict`, or of a recorded episode as N of them."""
        agent, extra = obs["agent"], obs["extra"]
        gripper = [agent["controller"]["gripper"]["target_opening"], extra["opening"], extra["force"]]
        pose = np.asarray(extra["target_pose"], float)
        T = np.tile(np.eye(4), (len(pose), 1, 1))
        T[:, :3, 3], T[:, :3, :3] = pose[:, :3], Rotation.from_quat(pose[:, 3:], scalar_first=True).as_matrix()
        return cls(np.asarray(agent["qpos"], float)[:, :6], np.concatenate(gripper, axis=1).astype(float), T)

    def moved(self, offset: np.ndarray) -> Moments:
        """With the joints moved by ``offset`` (N, 6), and what is held with the hand."""
        q = self.q + offset
        T = self.T_world_thing.copy()
        held = self.gripper[:, 2] > _HELD_N
        T[held] = tool(q[held]) @ np.linalg.inv(tool(self.q[held])) @ T[held]
        return Moments(q, self.gripper, T)

    def features(self) -> torch.Tensor:
        """(N, 36) float32: joints, gripper; tool, object, and object from the tool, each a place and the first two
        columns of its rotation: quaternions jump.
        """
        T_tool = tool(self.q)
        poses = (T_tool, self.T_world_thing, np.linalg.inv(T_tool) @ self.T_world_thing)
        flat = [part for T in poses for part in (T[:, :3, 3], T[:, :3, :2].reshape(-1, 6))]
        return torch.from_numpy(np.concatenate([self.q, self.gripper, *flat], axis=1).astype(np.float32))


def tool(q: np.ndarray) -> np.ndarray:
    """T_world_tcp (N, 4, 4) at joint angles (N, 6)."""
    return np.array([forward_kinematics(each) @ T_TOOL0_TCP for each in q]).reshape(-1, 4, 4)


def read_demonstrations(path: Path, chunk: int) -> tuple[list[tuple[Moments, np.ndarray]], dict[str, Any]]:
    """Of each episode its T moments and the actions (T, chunk, 8) that follow, the last one repeated beyond its end;
    and the arguments of the environment.

    Raises MomentsError where the file holds no episodes, or those of another control mode.
    """
    info = json.loads(path.with_suffix(".json").read_text())
    if not info["episodes"]:
        raise MomentsError(f"{path}: holds no episodes")
    episodes = []
    with h5py.File(path) as file:
        for episode in info["episodes"]:
            if episode["control_mode"] != CONTROL_MODE:
                raise MomentsError(f"{path}: control mode {episode['control_mode']}, must be {CONTROL_MODE}")
            trajectory = load_h5_data(file[f"traj_{episode['episode_id']}"])
            n = len(trajectory["actions"])
            following = np.minimum(np.arange(n)[:, None] + np.arange(chunk), n - 1)
            seen = index_dict(trajectory["obs"], slice(n))
            episodes.append((Moments.of(seen), trajectory["actions"][following]))
    return episodes, info["env_info"]["env_kwargs"]
