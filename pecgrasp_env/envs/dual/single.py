"""DualGraspSingle-v1: the same task as a plain Gymnasium environment, NumPy, no batches."""

from __future__ import annotations

from typing import Any, ClassVar

from pecgrasp_env.envs.dual.dual_grasp import DualGraspEnv
from pecgrasp_env.envs.unbatched import UnbatchedEnv


class DualGraspSingleEnv(UnbatchedEnv):
    """
    ## Description
    DualGrasp-v1 as Gymnasium defines an environment: observations and infos are NumPy arrays and Python values without
    a batch axis, `terminated` means success or failure, `truncated` the time limit, and `reset(seed=…)` fixes all.

    ## Action Space, Observation Space, Rewards, Starting State, Episode End
    Those of DualGrasp-v1; here the default `control_mode` is `pd_ee_delta_pose`, all in [−1, 1].

    ## Arguments
    `render_mode` (None, "rgb_array", "human"), and those of DualGrasp-v1 but `num_envs`, `reconfiguration_freq` and
    `parallel_in_single_scene`.

    ## Version History
    - v1: first version.
    """

    task_class: ClassVar[Any] = DualGraspEnv
    task_name: ClassVar[str] = "DualGrasp-v1"
