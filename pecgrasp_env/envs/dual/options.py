"""The arguments of DualGrasp-v1, checked when they are built; one that makes no sense is named."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.objects.procedural.for_two_arms.draw import KINDS

_CPU = ("auto", "physx_cpu", "cpu")


@dataclass(frozen=True)
class DualOptions:
    """What may lie there, and where the arms start; the card of `DualGraspEnv` has the meanings. Raises TaskError."""

    kinds: Sequence[str] = KINDS
    joint_noise: float = 0.02
    protective_stop: bool = True

    def __post_init__(self) -> None:
        unknown = [kind for kind in self.kinds if kind not in KINDS]
        if unknown or not self.kinds or len(set(self.kinds)) != len(self.kinds):
            raise TaskError(f"kinds={tuple(self.kinds)}: must name at least one of {', '.join(KINDS)}, each once")
        if not 0 <= self.joint_noise < float("inf"):
            raise TaskError(f"joint_noise={self.joint_noise}: must be a number and not negative")


def check_one_scene(num_envs: Any, sim_backend: str) -> None:
    """Raises TaskError where more than one scene, or a GPU's simulation, is asked for."""
    if num_envs != 1:
        raise TaskError(f"num_envs={num_envs!r}: DualGrasp-v1 simulates one scene; run more in processes of their own")
    if str(sim_backend).split(":")[0] not in _CPU:
        raise TaskError(f"sim_backend={sim_backend!r}: DualGrasp-v1 runs on the CPU, as 'physx_cpu'")
