"""Simulation: the robot, the objects, the sensor, the capture of labelled clouds, and the task SelectiveGrasp-v1.

Importing this registers with Gymnasium `SelectiveGrasp-v1`, batched as ManiSkill's tasks are, and
`SelectiveGraspSingle-v1`, the same for one robot without batches. It loads nothing else: ManiSkill, SAPIEN and torch
are imported where they are first used.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from pecgrasp_env.envs.registration import MAX_EPISODE_STEPS, register

if TYPE_CHECKING:
    from pecgrasp_env.policy.scripted import ScriptedPolicy

__all__ = ["MAX_EPISODE_STEPS", "ScriptedPolicy"]


# Parts of the package work without the simulation's extras (`pip install .[sim]`).
if find_spec("gymnasium") is not None:
    register()


def __getattr__(name: str) -> Any:
    if name == "ScriptedPolicy":
        from pecgrasp_env.policy.scripted import ScriptedPolicy

        return ScriptedPolicy
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
