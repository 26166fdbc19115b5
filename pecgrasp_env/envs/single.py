"""SelectiveGraspSingle-v1: the same task as a plain Gymnasium environment, one robot, NumPy, no batches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces

from pecgrasp_env.envs.selective_grasp import SelectiveGraspEnv
from pecgrasp_env.envs.validation import OBS_MODES, VECTORISED, ForkError, TaskError

_NOT_HERE = {"num_envs", "reconfiguration_freq", "parallel_in_single_scene"}
_LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-. "


class SelectiveGraspSingleEnv(gym.Env):
    """
    ## Description
    SelectiveGrasp-v1 for one robot on the CPU, as Gymnasium defines an environment: observations and infos are NumPy
    arrays and Python values without a batch axis, `terminated` means success or failure, `truncated` the time limit,
    and `reset(seed=…)` fixes everything. Nothing that is returned is written to afterwards.

    ## Action Space
    That of SelectiveGrasp-v1, `Box(8,)` float32; here the default `control_mode` is `pd_ee_delta_pose`, all in [−1, 1].

    ## Observation Space
    That of SelectiveGrasp-v1 in the `obs_mode`, any but `none`; by default `state`, one vector. All numbers have
    finite bounds. With `text_target`, in modes that are dictionaries, `target_name` is the asked-for class as a word.

    ## Rewards
    Those of SelectiveGrasp-v1.

    ## Starting State
    That of SelectiveGrasp-v1 with the same seed, and the same options of `reset`; every episode has new objects.

    ## Episode End
    As in SelectiveGrasp-v1.

    ## Arguments
    `text_target` (default False), `render_mode` (None, "rgb_array", "human"), and those of SelectiveGrasp-v1 but
    `num_envs`, `reconfiguration_freq` and `parallel_in_single_scene`. Many of them, each in a process of its own:
    `gymnasium.make_vec(id, num_envs=8, vectorization_mode="async", vector_kwargs={"context": "spawn"})`; the renderer
    does not survive a fork.

    ## Version History
    - v1: first version.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 20}  # noqa: RUF012
    _newest: ClassVar[tuple[spaces.Box, spaces.Space] | None] = None  # spaces of the one made last in this process

    def __init__(self, render_mode: str | None = None, text_target: bool = False, **kwargs: Any) -> None:
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise TaskError(f"render_mode={render_mode!r}: must be None or one of {modes}")
        for name in _NOT_HERE & kwargs.keys():
            many = f". Many single ones: {VECTORISED.format(n=kwargs[name])}" if name == "num_envs" else ""
            raise TaskError(f"{name}={kwargs[name]!r}: SelectiveGrasp-v1 takes it, not the single environment{many}")
        if kwargs.get("obs_mode") == "none":
            modes = OBS_MODES.replace("none, ", "")
            raise TaskError(f"obs_mode='none': a Gymnasium environment observes something, so one of {modes}")
        defaults = {"control_mode": "pd_ee_delta_pose", "sim_backend": "physx_cpu"}
        self.render_mode = render_mode
        self._text_target = text_target
        self._fork: ForkError | None = None
        try:
            self.task = SelectiveGraspEnv(**(defaults | kwargs), render_mode=render_mode)
        except ForkError as error:
            # In a worker of AsyncVectorEnv. It would end here, and the user read "connection reset"; an error of the
            # first reset is told instead, and until then only spaces are asked for: those of the parent's own one.
            if self._newest is None:
                raise
            self._fork = error
            self.action_space, self.observation_space = self._newest
            return
        self.action_space = spaces.Box(
            self.task.single_action_space.low, self.task.single_action_space.high, dtype=np.float32
        )
        self.observation_space = _without_empty(self.task.single_observation_space)
        if text_target:
            if not isinstance(self.observation_space, spaces.Dict):
                raise TaskError(f"text_target={text_target}: obs_mode={self.task.obs_mode!r} is no dictionary")
            longest = max(len(name) for name in self.task.classes)
            letters = "".join(sorted({*_LETTERS, *"".join(self.task.classes)}))
            word = spaces.Text(longest, min_length=1, charset=letters)
            self.observation_space = spaces.Dict({**self.observation_space.spaces, "target_name": word})
        SelectiveGraspSingleEnv._newest = (self.action_space, self.observation_space)

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
        """As `SelectiveGraspEnv.set_planner_reason`."""
        self.task.set_planner_reason(reason)

    def _observed(self, obs: Any, info: Mapping[str, Any]) -> Any:
        plain = _plain(obs)
        return {**plain, "target_name": info["target"][0]} if self._text_target else plain


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
