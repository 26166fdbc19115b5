"""From a frame to a grasp and the arm's path to it: how long each stage of the scripted policy computes.

The frame is of the task's wrist camera with a D435's faults, three objects on the table, one of which is decided for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from pecgrasp_env.benchmark.timing import Row, limited, rows_of, side_by_side

_TREE, _DECISION = "k-d tree of the frame", "frame to grasp and path"
_STAGES = ("segment", "classify", "plan grasp", "plan motion")


def decision(settings: Mapping[str, Any]) -> list[Row]:
    """`ScriptedPolicy.plan_only` with joint paths, beside a k-d tree of the frame, and what its stages take of it."""
    import gymnasium as gym
    import torch

    from pec import PEC, Classifier
    from pec.checkpoint import Checkpoint
    from pec.training.config import DatasetConfig, TrainConfig
    from pecgrasp_env.objects import LARS_CLASSES
    from pecgrasp_env.policy.observation import read_observation
    from pecgrasp_env.policy.scripted import ScriptedPolicy
    from pecgrasp_env.sensor import deproject

    env = gym.make("SelectiveGrasp-v1", obs_mode="depth", sensor="d435", sim_backend="physx_cpu", render_backend="cpu")
    observation = read_observation(env.reset(seed=settings["seed"])[0])
    env.close()
    torch.manual_seed(settings["seed"])
    model = PEC(64, len(LARS_CLASSES)).eval()  # weights do not matter to the time
    preprocess = TrainConfig(DatasetConfig(""), "").preprocess
    policy = ScriptedPolicy(Classifier(Checkpoint(model, list(LARS_CLASSES), preprocess, 1.0, 0)), min_confidence=1e-6)
    cloud = deproject(*observation.frame).reshape(-1, 3)
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    taken: dict[str, list[float]] = {stage: [] for stage in _STAGES}

    def decide() -> None:
        arguments = (*observation.frame, observation.T_base_camera, LARS_CLASSES[0])
        pick = policy.plan_only(*arguments, q=observation.q, opening=observation.opening)
        if pick.reason is not None:
            raise RuntimeError(f"seed={settings['seed']}: nothing to time, {pick.reason}")
        for stage in _STAGES:
            taken[stage] += policy.log.stages[stage]

    times = side_by_side({_TREE: lambda: cKDTree(cloud), _DECISION: decide}, settings["repeats"])
    rows = rows_of(
        times, _TREE, f"{observation.frame.intrinsics.width}x{observation.frame.intrinsics.height}, 3 objects"
    )
    rows[-1] = limited(rows[-1], settings.get("decide_at_most"))
    whole = times[_DECISION]
    for stage in _STAGES:
        wall = float(np.median(taken[stage][1:]))
        cpu = whole.cpu * wall / whole.wall  # the policy's log is of the clock
        row = {"wall_ms": 1000 * wall, "cpu_ms": 1000 * cpu, "times_yardstick": cpu / times[_TREE].cpu}
        rows.append({"what": "its share of that", "name": stage, **row})
    return rows
