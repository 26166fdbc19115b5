"""How fast each part is, beside a yardstick that is measured in the same run: ratios travel better than milliseconds.

How is said in `timing`. Every number is of one thread unless it says otherwise.
"""

from __future__ import annotations

import os
import platform
import warnings
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from grasping import Segmenter
from pecgrasp_env.benchmark.classification import classification
from pecgrasp_env.benchmark.decision import decision
from pecgrasp_env.benchmark.environment import environment
from pecgrasp_env.benchmark.generation import generation
from pecgrasp_env.benchmark.planning import planning
from pecgrasp_env.benchmark.robot import robot
from pecgrasp_env.benchmark.timing import Row, limited, line_of, rows_of, side_by_side
from pecgrasp_env.benchmark.training import training

_TREE = "k-d tree of the frame"
_UP = np.array([0.0, 0.0, 1.0])


def run_benchmark(settings: Mapping[str, Any], say: Callable[[str], None] = print) -> dict[str, Any]:
    """Measure the parts named in settings["parts"]; returns the rows of each, which `say` also gets as a table, with
    `machine`, and `limits`: how many were `held` and which were `not_held`.
    """
    import torch

    torch.set_num_threads(1)
    warnings.filterwarnings("ignore", message=".*Box (low|high)'s precision lowered")  # ManiSkill's float64 limits
    measure: dict[str, Callable[[Mapping[str, Any]], list[Row]]] = {
        "segmentation": segmentation,
        "planning": planning,
        "classification": classification,
        "training": training,
        "generation": generation,
        "environment": environment,
        "decision": decision,
        "robot": robot,
    }
    unknown = set(settings["parts"]) - measure.keys()
    if unknown:
        raise ValueError(f"parts={list(settings['parts'])}: there is no {unknown.pop()!r}, only {', '.join(measure)}")
    machine = {"cores": os.cpu_count(), "processor": _processor()}
    say(f"milliseconds: {machine['processor']}, {machine['cores']} cores, as busy as it is; limits: multiples (x) of a")
    say("yardstick in the same run, which is the row of 1.00 x")
    results: dict[str, Any] = {"machine": machine, "limits": {"held": 0, "not_held": []}}
    for part in settings["parts"]:
        rows = measure[part](settings)
        results[part] = rows
        say(f"\n{part}")
        for row in rows:
            say(line_of(row))
            if row.get("held"):
                results["limits"]["held"] += 1
            elif "held" in row:
                results["limits"]["not_held"].append(f"{part}: {row['what']}, {row['name']}")
    n_broken = len(results["limits"]["not_held"])
    say(f"\nlimits: {results['limits']['held']} of {results['limits']['held'] + n_broken} held")
    for name in results["limits"]["not_held"]:
        say(f"  not held: {name}")
    return results


def segmentation(settings: Mapping[str, Any]) -> list[Row]:
    """A frame of the task's wrist camera, so many objects apart or piled, beside a k-d tree of the frame's points.

    In the camera's frame, as the policy asks, things are told apart by their surfaces; in the robot's, in which nobody
    said where the camera stood, by the places that they stand on.
    """
    from pecgrasp_env.policy.observation import read_observation
    from pecgrasp_env.sensor import deproject

    rows = []
    for case in settings["segmented"]:
        count, clutter, resolution = case.split()
        env = _task(n_objects=int(count), clutter=clutter, resolution=resolution, obs_mode="depth")
        obs, _ = env.reset(seed=settings["seed"])
        observation = read_observation(obs)
        env.close()
        cloud, robot, T = deproject(*observation.frame), observation.robot, observation.T_base_camera
        of_robot = np.column_stack([robot[:, :3] @ T[:3, :3].T + T[:3, 3], robot[:, 3]])
        of_base = (cloud @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
        for frame, limits, points, up, body in (
            ("camera's frame", settings.get("segment_at_most", {}), cloud, T[:3, :3].T @ _UP, robot),
            ("robot's frame", settings.get("segment_in_base_at_most", {}), of_base, _UP, of_robot),
        ):
            valid = points[np.isfinite(points).all(axis=2)]
            segmenters: dict[str, Any] = {"default": Segmenter(), "published": Segmenter.published()}
            routines: dict[str, Callable[[], Any]] = {_TREE: partial(cKDTree, valid)}
            for name, segmenter in segmenters.items():
                routines[name] = partial(segmenter.segment, points, up=up, robot=body)
            times = side_by_side(routines, settings["repeats"])
            for row in rows_of(times, _TREE, f"{case}, {frame}, {len(valid):,} points"):
                if row["name"] in segmenters:
                    row["objects_found"] = len(segmenters[row["name"]].segment(points, up=up, robot=body).objects)
                rows.append(limited(row, limits.get(case) if row["name"] == "default" else None))
    return rows


def _task(**arguments: Any) -> Any:
    import gymnasium as gym

    backends = {"sim_backend": "physx_cpu", "render_backend": "cpu", "control_mode": "pd_joint_pos"}
    return gym.make("SelectiveGrasp-v1", **{**backends, **arguments})


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        if names:
            return names[0]
    return platform.processor() or platform.machine()
