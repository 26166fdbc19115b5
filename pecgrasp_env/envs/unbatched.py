"""A ManiSkill task without its batch axis: a plain Gymnasium environment, NumPy, on the CPU."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces

from pecgrasp_env.envs.validation import OBS_MODES, VECTORISED, ForkError, TaskError


class UnbatchedEnv(gym.Env):
    """Observations and infos are NumPy arrays and Python values without a batch axis, and `reset(seed=…)` fixes all.

    task_class: the ManiSkill task; task_name: what it is registered as. not_here: arguments of it that none has here.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 20}  # noqa: RUF012
    task_class: ClassVar[Any]
    task_name: ClassVar[str]
    not_here: ClassVar[tuple[str, ...]] = ("num_envs", "reconfiguration_freq", "parallel_in_single_scene")
    _newest: ClassVar[dict[type, tuple[spaces.Box, spaces.Space]]] = {}  # spaces of those made last in this process

    def __init__(self, render_mode: str | None = None, **kwargs: Any) -> None:
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise TaskError(f"render_mode={render_mode!r}: must be None or one of {modes}")
        for name in [each for each in self.not_here if each in kwargs]:
            many = f". Many single ones: {VECTORISED.format(n=kwargs[name])}" if name == "num_envs" else ""
            raise TaskError(f"{name}={kwargs[name]!r}: {self.task_name} takes it, not the single environment{many}")
        if kwargs.get("obs_mode") == "none":
            modes = OBS_MODES.replace("none, ", "")
            raise TaskError(f"obs_mode='none': a Gymnasium environment observes something, so one of {modes}")
        defaults = {"control_mode": "pd_ee_delta_pose", "sim_backend": "physx_cpu"}
        self.render_mode = render_mode
        self._fork: ForkError | None = None
        try:
            self.task = self.task_class(**(defaults | kwargs), render_mode=render_mode)
        except ForkError as error:
            # In a worker of AsyncVectorEnv. It would end here, and the user read "connection reset"; an error of the
            # first reset is told instead, and until then only spaces are asked for: those of the parent's own one.
            if type(self) not in self._newest:
                raise
            self._fork = error
            self.action_space, self.observation_space = self._newest[type(self)]
            return
        self.action_space = spaces.Box(
            self.task.single_action_space.low, self.task.single_action_space.high, dtype=np.float32
        )
        self.observation_space = self._space(_without_empty(self.task.single_observation_space))
        self._newest[type(self)] = (self.action_space, self.observation_space)

    def _space(self, space: spaces.Space) -> spaces.Space:
        """That of the observations, from the task's."""
        return space

    def _observed(self, obs: Any, info: Mapping[str, Any]) -> Any:
        """An observation, from the task's."""
        return _plain(obs)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        if self._fork is not None:
            raise self._fork
        super().reset(seed=seed)
        episode = seed if seed is not None else int(self.np_random.integers(2**31))
        obs, info = self.task.reset(seed=episode, options=options)
        if self.render_mode == "human":
            self.render()
        return self._observed(obs, info), _plain(info)

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        obs, reward, terminated, _, info = self.task.step(np.asarray(action, np.float32))
        if self.render_mode == "human":
            self.render()
        return self._observed(obs, info), float(reward), bool(terminated), False, _plain(info)

    def render(self) -> np.ndarray | None:
        """An (H, W, 3) uint8 picture from outside in the mode "rgb_array"; in "human" a window, which steps redraw."""
        if self.render_mode == "rgb_array":
            return self.task.render_rgb_array()[0].cpu().numpy().copy()
        if self.render_mode == "human":
            self.task.render_human()
        return None

    def close(self) -> None:
        if self._fork is None:
            self.task.close()

    def set_planner_reason(self, reason: str) -> None:
        """As the task's `set_planner_reason`."""
        self.task.set_planner_reason(reason)


def _without_empty(space: spaces.Space) -> spaces.Space:
    """Without dictionaries that hold nothing, such as ManiSkill leaves where the images became a point cloud."""
    if not isinstance(space, spaces.Dict):
        return space
    inner = {key: _without_empty(each) for key, each in space.spaces.items()}
    return spaces.Dict({key: each for key, each in inner.items() if not isinstance(each, spaces.Dict) or each.spaces})


def _plain(value: Any) -> Any:
    """Without the batch axis, copied: mappings that are not empty, arrays, and numbers where there is one number."""
    if isinstance(value, Mapping):
        inner = {key: _plain(item) for key, item in value.items()}
        return {key: item for key, item in inner.items() if not isinstance(item, dict) or item}
    if isinstance(value, np.ndarray):  # words
        return value[0]
    if not isinstance(value, torch.Tensor):
        return value
    first = value[0].cpu()
    return first.item() if first.ndim == 0 else first.numpy().copy()
