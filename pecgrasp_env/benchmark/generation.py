"""Labelled clouds a second beside the rasteriser alone, and beside one ManiSkill environment of as many pixels stepped
for each cloud; and where the time goes.

The rate is that of a whole `generate`, files included, from its first shard to its last: processes start but once. The
yardstick is the rasteriser alone: the frames that one process draws and reads back of the same objects in the same
poses.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pecgrasp_env.benchmark.timing import Row, Timing, limited, rows_of
from pecgrasp_env.objects import LARS_CLASSES, make_object

if TYPE_CHECKING:
    from pecgrasp_env.capture import CaptureConfig
    from pecgrasp_env.capture.scenarios.base import Scenario, Subject

__all__ = ["generation", "memory_growth"]

_RASTERISER = "rasteriser alone"
_STEPPED = "ManiSkill, a step a cloud"
_WARM_UP = 500  # frames after which buffers have their size
_SAMPLES = 50  # of an object, captured in one go where memory is measured


def generation(settings: Mapping[str, Any]) -> list[Row]:
    """One row a case and number of processes, those of the yardstick and of the floor, the shares of a frame's time,
    and, where settings["memory_frames"] is not 0, the growth of memory over so many frames.
    """
    from pecgrasp_env.capture import CaptureConfig, ObjectsConfig

    per_instance = max(4, settings["clouds"] // (2 * len(LARS_CLASSES)))
    objects = ObjectsConfig(instances_per_class=2, seed=settings["seed"])
    cases: dict[str, CaptureConfig] = {}
    for scenario, sensor, resolution in (case.split() for case in settings["generation_cases"]):
        cases[f"{scenario} {sensor} {resolution}"] = CaptureConfig(
            scenario=scenario,
            objects=objects,
            samples_per_instance=per_instance,
            sensor=sensor,
            resolutions=(resolution,),
            # Several shards an instance: the first to arrive starts the clock, the last stops it.
            shard_size=max(1, per_instance // 4) * (3 if scenario == "tabletop" else 1),
        )
    stepped = {
        f"PickCube-v1 pointcloud {resolution}": _stepped_clouds(settings, resolution)
        for resolution in dict.fromkeys(config.resolutions[0] for config in cases.values())
    }
    seconds: dict[tuple[str, str], list[float]] = {}
    for _ in range(settings["generation_repeats"]):
        for case, config in cases.items():
            for workers in settings["workers"]:
                name = f"{workers} worker{'s' if workers > 1 else ''}"
                seconds.setdefault((case, name), []).append(_seconds_a_cloud(config, workers))
        for case, step in stepped.items():
            seconds.setdefault((case, _STEPPED), []).append(step())
    times = {key: Timing(float(np.median(each)), float("nan")) for key, each in seconds.items()}
    rows = []
    for case, config in cases.items():
        shares = _shares(config)
        stepped_case = f"PickCube-v1 pointcloud {config.resolutions[0]}"
        beside = {_RASTERISER: shares[_RASTERISER], _STEPPED: times[stepped_case, _STEPPED]}
        beside |= {name: timing for (of, name), timing in times.items() if of == case}
        for row in rows_of(beside, _RASTERISER, case, rate="clouds/s"):
            limit = settings["generate_at_most"].get(case) if row["name"].endswith("workers") else None
            what = stepped_case if row["name"] == _STEPPED else case
            rows.append(limited(row, limit) | {"what": what})
        rows += rows_of(shares, "all of it", f"{case}, one process", rate="clouds/s")
    if settings["memory_frames"]:
        rows += [memory_growth(case, _capture(config), settings["memory_frames"]) for case, config in cases.items()]
    return rows


def _seconds_a_cloud(config: CaptureConfig, workers: int) -> float:
    """Of one `generate`, between its first shard and its last."""
    from pecgrasp_env.capture import generate

    arrived: list[tuple[int, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        generate(
            config,
            Path(folder) / "clouds",
            workers=workers,
            progress=lambda done, total: arrived.append((done, time.perf_counter())),
        )
    _, (n_first, first), *_, (n_last, last) = arrived
    return (last - first) / (n_last - n_first)


def _shares(config: CaptureConfig) -> dict[str, Timing]:
    """What one process spends on a cloud, by part and in all; the rasteriser's is the yardstick."""
    from pecgrasp_env.capture.rendering import tabletop_depth as table
    from pecgrasp_env.capture.rendering.depth_renderer import DepthRenderer
    from pecgrasp_env.capture.scenarios import free, tabletop

    scenario, subjects = _opened(config)
    scenario.capture(subjects, 0, 2)  # resting poses, cameras
    spent: dict[str, float] = {}
    with (
        _timed(DepthRenderer, "render_window", spent, _RASTERISER),
        _timed(free, "measure", spent, "sensor model"),
        _timed(tabletop, "measured_table", spent, "sensor model"),
        _timed(tabletop, "segment_frame", spent, "segmentation"),
        _timed(tabletop, "arrange", spent, "layout of the table"),
        _timed(table, "background_depth", spent, "table and floor"),
    ):
        begin = time.perf_counter()
        n = len(scenario.capture(subjects, 2, 40).samples)
        total = time.perf_counter() - begin
    parts = {name: value for name, value in spent.items() if value}
    parts["the rest"] = total - sum(parts.values())
    times = {name: Timing(value / n, float("nan")) for name, value in parts.items()}
    times["all of it"] = Timing(total / n, float("nan"))
    return times


@contextmanager
def _timed(owner: Any, name: str, spent: dict[str, float], label: str) -> Iterator[None]:
    """Adds the seconds spent in owner.name to spent[label]."""
    original = getattr(owner, name)

    def timed(*args: Any, **kwargs: Any) -> Any:
        begin = time.perf_counter()
        try:
            return original(*args, **kwargs)
        finally:
            spent[label] = spent.get(label, 0.0) + time.perf_counter() - begin

    setattr(owner, name, timed)
    try:
        yield
    finally:
        setattr(owner, name, original)


def _capture(config: CaptureConfig) -> Callable[[int], int]:
    """Captures 50 samples of each of a few objects from the one that is named on; returns how many frames that took."""
    scenario, subjects = _opened(replace(config, samples_per_instance=10**9))
    in_a_frame = len(subjects) if config.scenario == "tabletop" else 1

    def capture(first: int) -> int:
        captured = scenario.capture(subjects, first, _SAMPLES)
        return (len(captured.samples) + captured.rejected.total()) // in_a_frame

    return capture


def memory_growth(case: str, capture: Callable[[int], int], frames: int) -> Row:
    """How much one process grows over so many frames, first half and second apart: the renderer's buffers reach their
    size within thousands of frames, as rare sizes of windows come up; what grows for ever grows in both.

    capture: takes frames, from a sample that it is given on, and returns how many.
    """
    taken, first = 0, 0
    sizes: list[float] = []
    begin = time.perf_counter()
    for mark in (_WARM_UP, _WARM_UP + frames // 2, _WARM_UP + frames):
        while taken < mark:
            taken += capture(first)
            first += _SAMPLES
        sizes.append(_resident_mb())
    return {
        "what": f"{case}, {frames:,} frames",
        "name": "memory",
        "wall_ms": 1000 * (time.perf_counter() - begin) / taken,
        "mb": sizes[0],
        "growth_first_half_mb": sizes[1] - sizes[0],
        "growth_mb": sizes[2] - sizes[1],
    }


def _opened(config: CaptureConfig) -> tuple[Scenario, list[Subject]]:
    from pecgrasp_env.capture.scenarios import open_scenario
    from pecgrasp_env.capture.scenarios.base import Subject

    subjects = [Subject(make_object(name, config.objects.seed), i, i) for i, name in enumerate(LARS_CLASSES[:3])]
    return open_scenario(config), subjects


def _resident_mb() -> float:
    """Memory of this process that is in RAM, MB; 0 where the system does not say."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1000 for line in lines if line.startswith("VmRSS:")), 0.0)


def _stepped_clouds(settings: Mapping[str, Any], resolution: str) -> Callable[[], float]:
    """Seconds a cloud of the obvious generator: ManiSkill's own PickCube-v1 with as many pixels, one step a cloud."""
    import gymnasium as gym
    import mani_skill.envs

    assert mani_skill.envs  # registers PickCube-v1
    env = gym.make(
        "PickCube-v1",
        obs_mode="pointcloud",
        sim_backend="physx_cpu",
        render_backend="cpu",
        sensor_configs=dict(zip(("width", "height"), map(int, resolution.split("x")), strict=True)),
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
