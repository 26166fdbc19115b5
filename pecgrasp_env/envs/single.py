"""SelectiveGraspSingle-v1: the same task as a plain Gymnasium environment, one robot, NumPy, no batches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from gymnasium import spaces

from pecgrasp_env.envs.selective_grasp import SelectiveGraspEnv
from pecgrasp_env.envs.unbatched import UnbatchedEnv
from pecgrasp_env.envs.validation import TaskError

_LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-. "


class SelectiveGraspSingleEnv(UnbatchedEnv):
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

    task_class: ClassVar[Any] = SelectiveGraspEnv
    task_name: ClassVar[str] = "SelectiveGrasp-v1"

    def __init__(self, render_mode: str | None = None, text_target: bool = False, **kwargs: Any) -> None:
        self._text_target = text_target
        super().__init__(render_mode, **kwargs)

    def _space(self, space: spaces.Space) -> spaces.Space:
        if not self._text_target:
            return space
        if not isinstance(space, spaces.Dict):
            raise TaskError(f"text_target={self._text_target}: obs_mode={self.task.obs_mode!r} is no dictionary")
        longest = max(len(name) for name in self.task.classes)
        letters = "".join(sorted({*_LETTERS, *"".join(self.task.classes)}))
        word = spaces.Text(longest, min_length=1, charset=letters)
        return spaces.Dict({**space.spaces, "target_name": word})

    def _observed(self, obs: Any, info: Mapping[str, Any]) -> Any:
        plain = super()._observed(obs, info)
        return {**plain, "target_name": info["target"][0]} if self._text_target else plain
