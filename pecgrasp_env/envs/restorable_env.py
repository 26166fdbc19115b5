"""The task's whole state, taken out and put back: what the simulator knows, and what the task itself remembers."""

from __future__ import annotations

from typing import Any

import torch

from pecgrasp_env.envs.task_state import Memory, batched, unflatten
from pecgrasp_env.envs.validation import TaskError
from pecgrasp_env.envs.wrist_camera_env import WristCameraEnv
from pecgrasp_env.robot.agent import UR5Robotiq2F140


class RestorableEnv(WristCameraEnv):
    """An environment whose state has its ``memory`` in it.

    classes: names of the classes. target_names: the asked-for one of each sub-environment.
    """

    agent: UR5Robotiq2F140
    memory: Memory
    classes: tuple[str, ...]
    target_names: list[str]

    def get_state_dict(self) -> dict[str, Any]:
        """The state of the simulation, of the controllers, and of the task: `Memory`, step, joints before."""
        task = self.memory.to_state()
        task["elapsed_steps"] = self._elapsed_steps[:, None].float()
        task["qpos_before"] = self.agent._qpos_before.clone()
        return {**super().get_state_dict(), "task": task}

    def set_state_dict(self, state: dict[str, Any], env_idx: torch.Tensor | None = None) -> None:
        """Put the sub-environments ``env_idx`` (all) into a state of `get_state_dict`, or of a recorded trajectory.

        What PhysX remembers of contacts is no part of it: what pads feel is known after the next step.

        Raises:
            TaskError: the state is of other objects than those on the table.
        """
        rows = torch.arange(self.num_envs, device=self.device) if env_idx is None else env_idx
        task, controllers_then = (batched(state[key], self.device) for key in ("task", "controller"))
        if not torch.equal(task["instances"].long(), self.memory.instances[rows]):
            raise TaskError("state: is of other objects; reset with the seed of its episode first")
        super().set_state_dict(state, env_idx)
        controllers = self.agent.get_controller_state()
        for name, values in controllers_then.items():
            for key, value in values.items():
                controllers[name][key][rows] = value.clone()  # which may be what it is to replace
        self.agent.set_controller_state(controllers)
        self.memory.restore(task, rows)
        self._elapsed_steps[rows] = task["elapsed_steps"][:, 0].to(self._elapsed_steps.dtype)
        self.agent._qpos_before[rows] = task["qpos_before"]
        for i in rows.tolist():
            self.target_names[i] = self.classes[int(self.memory.asked[i])]

    def set_state(self, state: torch.Tensor, env_idx: torch.Tensor | None = None) -> None:
        """The same from a flat state (N, D) of `get_state`."""
        self.set_state_dict(unflatten(state, self._init_raw_state)[0], env_idx)
