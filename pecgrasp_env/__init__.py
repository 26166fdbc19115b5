"""Simulation: the robot, the objects, the sensor, the capture of labelled clouds, and the task SelectiveGrasp-v1.

Importing this registers with Gymnasium `SelectiveGrasp-v1`, batched as ManiSkill's tasks are, and
`SelectiveGraspSingle-v1`, the same for one robot without batches. It loads nothing else: ManiSkill, SAPIEN and torch
are imported where they are first used.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pecgrasp_env.policy import ScriptedPolicy

__all__ = ["MAX_EPISODE_STEPS", "ScriptedPolicy"]

MAX_EPISODE_STEPS = 400


def _register() -> None:
    import gymnasium
    from gymnasium.envs.registration import WrapperSpec

    # As ManiSkill's own `register_env` does, but by name, so that nothing heavy is imported before `make`.
    gymnasium.register(
        "SelectiveGrasp-v1",
        entry_point="pecgrasp_env.selective_grasp:SelectiveGraspEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
        disable_env_checker=True,  # batched tensors; `check_env` is for the unbatched form
        additional_wrappers=(
            WrapperSpec(
                "MSTimeLimit",
                "mani_skill.utils.registration:TimeLimitWrapper",
                {"max_episode_steps": MAX_EPISODE_STEPS},
            ),
        ),
    )
    gymnasium.register(
        "SelectiveGraspSingle-v1",
        entry_point="pecgrasp_env.single:SelectiveGraspSingleEnv",
        max_episode_steps=MAX_EPISODE_STEPS,
    )


# Parts of the package work without the simulation's extras (`pip install .[sim]`).
if find_spec("gymnasium") is not None:
    _register()


def __getattr__(name: str) -> Any:
    if name == "ScriptedPolicy":
        from pecgrasp_env.policy import ScriptedPolicy

        return ScriptedPolicy
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
