"""Control steps a second of SelectiveGrasp-v1, standing still and with the scripted policy at work, beside ManiSkill's
own PickCube-v1 at the same observation in the same run. Resets are not counted.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from pecgrasp_env.benchmark.timing import Row, Timing, rows_of
from pecgrasp_env.sensor import D435

_BACKENDS = {"sim_backend": "physx_cpu", "render_backend": "cpu", "control_mode": "pd_joint_pos"}
_RESOLUTION = "424x240"
_YARDSTICK = "PickCube-v1, depth"


class _Standing:
    """An environment whose robot is commanded to stay where it is."""

    def __init__(self, env: Any, hand: tuple[float, ...]) -> None:
        self.env, self._hand = env, hand

    def begin(self, seed: int) -> None:
        self.env.reset(seed=seed)
        arm = self.env.action_space.shape[-1] - len(self._hand)
        q = self.env.unwrapped.agent.robot.get_qpos()[0, :arm].cpu().numpy()
        self._action = np.append(q, self._hand).astype(np.float32)

    def step(self) -> None:
        self.env.step(self._action)


class _Picking:
    """SelectiveGrasp-v1 with the scripted policy, without a classifier: it takes the largest thing."""

    def __init__(self, env: Any) -> None:
        from pecgrasp_env.policy.scripted import ScriptedPolicy

        self.env, self._policy = env, ScriptedPolicy(None)

    def begin(self, seed: int) -> None:
        self._obs, info = self.env.reset(seed=seed)
        self._policy.reset(info["target"][0])

    def step(self) -> None:
        self._obs = self.env.step(self._policy.act(self._obs))[0]


def environment(settings: Mapping[str, Any]) -> list[Row]:
    """Rows of each environment and observation; one environment a process, one thread."""
    import gymnasium as gym
    import mani_skill.envs  # registers PickCube-v1

    assert mani_skill.envs
    intrinsics = D435[_RESOLUTION]
    pixels = {"width": intrinsics.width, "height": intrinsics.height}

    def ours(**arguments: Any) -> Any:
        return gym.make("SelectiveGrasp-v1", resolution=_RESOLUTION, **_BACKENDS, **arguments)

    routines: dict[str, _Standing | _Picking] = {}
    for mode in ("state", "depth"):
        cube = gym.make("PickCube-v1", obs_mode=mode, sensor_configs=pixels, **_BACKENDS)
        routines[f"PickCube-v1, {mode}"] = _Standing(cube, (0.04,))
        routines[f"ours, {mode}"] = _Standing(ours(obs_mode=mode), (0.14, 60.0))
    routines["ours, depth of a D435, policy"] = _Picking(ours(obs_mode="depth", sensor="d435"))
    steps = int(settings["steps"])
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in routines}
    for repeat in range(settings["generation_repeats"] + 1):
        for name, each in routines.items():
            each.begin(settings["seed"] + repeat)
            wall, cpu = time.perf_counter(), time.process_time()
            for _ in range(steps):
                each.step()
            if repeat:
                seconds[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    for each in routines.values():
        each.env.close()
    times = {name: Timing(*(np.median(turns, axis=0) / steps).tolist()) for name, turns in seconds.items()}
    return rows_of(times, _YARDSTICK, f"one environment, {_RESOLUTION}", rate="steps/s")
