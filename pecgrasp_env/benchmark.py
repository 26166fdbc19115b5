"""How fast each part is, beside a yardstick that is measured in the same run: ratios travel better than milliseconds.

Routines that are compared take turns, so that a busy machine slows all of them alike. Every number is a median, of one
thread unless it says otherwise. Beside the time on the clock stands the processor's time: where the machine has other
work to do the first grows and the second hardly.
"""

from __future__ import annotations

import os
import platform
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from grasping import CentroidPlanner, CurvaturePlanner, PublishedPlanner, Segmenter
from grasping.selective import Planner
from pecgrasp_env.objects import LARS_CLASSES, make_object

Row = dict[str, Any]

_TABLE = np.array([0.0, 0.0, 1.0, 0.0])
_UP = np.array([0.0, 0.0, 1.0])


def run_benchmark(settings: Mapping[str, Any], say: Callable[[str], None] = print) -> dict[str, Any]:
    """Measure the parts named in settings["parts"]; returns the rows of each, which `say` is also told as a table."""
    import torch

    torch.set_num_threads(1)
    warnings.filterwarnings("ignore", message=".*Box (low|high)'s precision lowered")  # ManiSkill's float64 limits
    measure: dict[str, Callable[[Mapping[str, Any]], list[Row]]] = {
        "segmentation": segmentation,
        "planning": planning,
        "classification": classification,
        "generation": generation,
        "environment": environment,
    }
    unknown = set(settings["parts"]) - measure.keys()
    if unknown:
        raise ValueError(f"parts={list(settings['parts'])}: there is no {unknown.pop()!r}, only {', '.join(measure)}")
    results: dict[str, Any] = {"machine": {"cores": os.cpu_count(), "processor": _processor()}}
    for part in settings["parts"]:
        rows = measure[part](settings)
        results[part] = rows
        say(f"\n{part}")
        for row in rows:
            say(_line(row))
    return results


@dataclass(frozen=True)
class Timing:
    """Median seconds of a routine: on the clock, and of this process's processor time."""

    wall: float
    cpu: float


def side_by_side(routines: Mapping[str, Callable[[], Any]], repeats: int) -> dict[str, Timing]:
    """Time the routines, which take turns, after one turn that does not count."""
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in routines}
    for repeat in range(repeats + 1):
        for name, routine in routines.items():
            wall, cpu = time.perf_counter(), time.process_time()
            routine()
            if repeat:
                seconds[name].append((time.perf_counter() - wall, time.process_time() - cpu))
    return {name: Timing(*np.median(each, axis=0).tolist()) for name, each in seconds.items()}


def segmentation(settings: Mapping[str, Any]) -> list[Row]:
    """A frame of the task's wrist camera, five objects on the table, beside a k-d tree of the frame's points."""
    from pecgrasp_env.perception import gripper_mask, read_observation
    from pecgrasp_env.sensor import deproject

    rows = []
    for resolution in settings["resolutions"]:
        env = _task(n_objects=5, resolution=resolution, obs_mode="depth")
        obs, _ = env.reset(seed=settings["seed"])
        percept = read_observation(obs)
        env.close()
        cloud = deproject(percept.depth, percept.intrinsics)
        cloud[gripper_mask(cloud, percept.opening)] = np.nan
        T = percept.T_base_camera
        cloud = (cloud @ T[:3, :3].T + T[:3, 3]).astype(np.float32)
        valid = cloud[np.isfinite(cloud).all(axis=2)]
        segmenter, published = Segmenter(), Segmenter.published()
        found = len(segmenter.segment(cloud, up=_UP).objects)
        times = side_by_side(
            {
                "k-d tree of the frame": partial(cKDTree, valid),
                "default": partial(segmenter.segment, cloud, up=_UP),
                "published": partial(published.segment, cloud, up=_UP),
            },
            settings["repeats"],
        )
        rows += _rows(times, "k-d tree of the frame", f"{resolution}, {len(valid):,} points, {found} objects found")
    return rows


def planning(settings: Mapping[str, Any]) -> list[Row]:
    """One object on a table, of several sizes of cloud, beside a k-d tree of the same cloud and GGA."""
    mesh = make_object("stapler", settings["seed"]).visual_mesh()
    rows = []
    planners: dict[str, Planner] = {
        "default": CurvaturePlanner(),
        "published": PublishedPlanner(),
        "GGA": CentroidPlanner(),
    }
    for n in settings["cloud_sizes"]:
        points = np.asarray(mesh.sample(n, seed=settings["seed"]), float)
        points[:, 2] -= points[:, 2].min()
        routines: dict[str, Callable[[], Any]] = {"k-d tree": partial(cKDTree, points)}
        for name, planner in planners.items():
            routines[name] = partial(planner.plan, points, up=_UP, table=_TABLE)
        rows += _rows(side_by_side(routines, settings["repeats"]), "k-d tree", f"{n:,} points")
    return rows


def classification(settings: Mapping[str, Any]) -> list[Row]:
    """Preprocessing and PEC, one cloud at a time, ours and as published, beside a k-d tree of the same cloud."""
    import torch

    from pec import PEC, Classifier
    from pec.checkpoint import Checkpoint
    from pec.config import DatasetConfig, TrainConfig
    from pec.preprocess import Preprocess

    torch.manual_seed(settings["seed"])
    classes = list(LARS_CLASSES)
    n_points = 64
    published = Preprocess(n_points=n_points, n_candidates=n_points, ordering="groups", group_size=16)
    ways = {"default": TrainConfig(DatasetConfig(""), "").preprocess, "published": published}
    model = PEC(n_points, len(classes)).eval()  # weights do not matter to the time
    mesh = make_object("stapler", settings["seed"]).visual_mesh()
    rows = []
    for n in settings["classified_sizes"]:
        points = np.asarray(mesh.sample(n, seed=settings["seed"]), np.float32)
        routines: dict[str, Callable[[], Any]] = {"k-d tree": partial(cKDTree, points)}
        for name, way in ways.items():
            classifier = Classifier(Checkpoint(model, classes, way, 1.0, 0))
            routines[name] = partial(classifier.predict, points)
        rows += _rows(side_by_side(routines, settings["repeats"]), "k-d tree", f"{n:,} points, {n_points} taken")
    return rows


def generation(settings: Mapping[str, Any]) -> list[Row]:
    """Labelled clouds a second once the processes run, beside one ManiSkill environment stepped for each cloud."""
    from pecgrasp_env.capture import CaptureConfig, ObjectsConfig, generate

    objects = ObjectsConfig(instances_per_class=2, seed=settings["seed"])
    per_instance = max(4, settings["clouds"] // (2 * len(LARS_CLASSES)))
    # Four shards an instance: the first to arrive starts the clock, the last stops it.
    config = CaptureConfig(objects=objects, samples_per_instance=per_instance, shard_size=max(1, per_instance // 4))
    seconds: dict[str, list[float]] = {}
    start_up: dict[str, list[float]] = {}
    stepped = _stepped_clouds(settings)
    for _ in range(settings["generation_repeats"]):
        for workers in settings["workers"]:
            name = f"{workers} worker{'s' if workers > 1 else ''}"
            arrived: list[tuple[int, float]] = []

            def note(done: int, total: int, to: list[tuple[int, float]] = arrived) -> None:
                to.append((done, time.perf_counter()))

            with tempfile.TemporaryDirectory() as folder:
                generate(config, Path(folder) / "clouds", workers=workers, progress=note)
            (_, begin), (n_first, first), *_, (n_last, last) = arrived
            seconds.setdefault(name, []).append((last - first) / (n_last - n_first))
            start_up.setdefault(name, []).append(first - begin)
        seconds.setdefault("ManiSkill, a step a cloud", []).append(stepped())
    times = {name: Timing(float(np.median(each)), float("nan")) for name, each in seconds.items()}
    what = f"{config.resolution}, {per_instance * 2 * len(LARS_CLASSES)} clouds"
    rows = _rows(times, "ManiSkill, a step a cloud", what, rate="clouds/s")
    return [row | {"first_shard_s": float(np.median(start_up.get(row["name"], [0.0])))} for row in rows]


def environment(settings: Mapping[str, Any]) -> list[Row]:
    """Control steps a second of SelectiveGrasp-v1 with three objects, without pictures and with the wrist's depth."""
    steps = settings["steps"]
    modes = ("state", "depth")
    envs = {mode: _task(obs_mode=mode) for mode in modes}
    still = {}
    for mode, env in envs.items():
        env.reset(seed=settings["seed"])
        still[mode] = np.r_[env.unwrapped.agent.robot.get_qpos()[0, :6].cpu().numpy(), 0.14, 60].astype(np.float32)

    def run(mode: str) -> None:
        for _ in range(steps):
            envs[mode].step(still[mode])

    routines = {f"obs_mode={mode}": partial(run, mode) for mode in modes}
    times = {
        name: Timing(each.wall / steps, each.cpu / steps)
        for name, each in side_by_side(routines, settings["generation_repeats"]).items()
    }
    for env in envs.values():
        env.close()
    return _rows(times, "obs_mode=state", "one environment, three objects", rate="steps/s")


def _stepped_clouds(settings: Mapping[str, Any]) -> Callable[[], float]:
    """Seconds a cloud of the obvious generator: ManiSkill's own PickCube-v1 with the same camera, one step a cloud."""
    import gymnasium as gym
    import mani_skill.envs

    assert mani_skill.envs  # registers PickCube-v1
    env = gym.make(
        "PickCube-v1",
        obs_mode="pointcloud",
        sim_backend="physx_cpu",
        render_backend="cpu",
        sensor_configs={"width": 424, "height": 240},
    )
    env.reset(seed=settings["seed"])
    action = np.zeros(env.action_space.shape, np.float32)
    env.step(action)

    def run(steps: int = settings["rival_clouds"]) -> float:
        begin = time.perf_counter()
        for _ in range(steps):
            env.step(action)
        return (time.perf_counter() - begin) / steps

    return run


def _task(**arguments: Any) -> Any:
    import gymnasium as gym

    import pecgrasp_env

    assert pecgrasp_env  # registers SelectiveGrasp-v1
    backends = {"sim_backend": "physx_cpu", "render_backend": "cpu", "control_mode": "pd_joint_pos"}
    return gym.make("SelectiveGrasp-v1", **{**backends, **arguments})


def _rows(times: Mapping[str, Timing], yardstick: str, what: str, rate: str | None = None) -> list[Row]:
    """One row a routine. Its ratio to the yardstick is of processor time, or of the clock's where there is a rate:
    processes and the renderer's threads work side by side.
    """
    rows = []
    for name, each in times.items():
        row: Row = {"what": what, "name": name, "wall_ms": 1000 * each.wall}
        if rate is None:
            row |= {"cpu_ms": 1000 * each.cpu, "times_yardstick": each.cpu / times[yardstick].cpu}
        else:
            row |= {"times_yardstick": each.wall / times[yardstick].wall, "rate": 1 / each.wall, "unit": rate}
        rows.append(row)
    return rows


def _line(row: Row) -> str:
    other = f"{row['rate']:>10.1f} {row['unit']}" if "rate" in row else f"{row['cpu_ms']:>10.3f} ms of processor"
    return f"  {row['what']:<44}{row['name']:<28}{row['wall_ms']:>10.3f} ms{other:<30}{row['times_yardstick']:>9.2f} x"


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        if names:
            return names[0]
    return platform.processor() or platform.machine()
