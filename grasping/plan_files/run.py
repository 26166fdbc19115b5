"""From files with clouds to grasps: read, segment where it is a scene, plan on each object, say what came of it.

A file that cannot be read or planned on does not stop the others: its `error` says why.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasping.cloud_files import SUFFIXES, read_cloud, valid_points
from grasping.errors import CloudError, ConfigError
from grasping.grasp import Grasp, GraspPlan
from grasping.gripper import Gripper
from grasping.plan_files.page import plan_page
from grasping.plan_files.results import PlannedFile, PlannedObject
from grasping.segmentation.segmenter import PublishedSegmenter, Scene, Segmenter
from grasping.selective import Planner
from grasping.validation import LARGEST_OBJECT, unit_vector

SURROUNDINGS = 0.12  # m around an object that are shown with it
FARTHEST_SCENE = 20.0  # m; no depth camera over a table sees half of its points beyond


@dataclass(frozen=True)
class Task:
    """How to plan on files.

    segmenter: each file is a whole scene, which it cuts into objects; None: each file is one object. up: (3,) away
    from the table in the clouds' frame; None: a table that is found says it, and without one the object's own axes
    stand for it. scale: metres in a unit of the files, 0.001 for millimetres.
    """

    planner: Planner
    gripper: Gripper
    segmenter: Segmenter | PublishedSegmenter | None = None
    up: ArrayLike | None = None
    scale: float = 1.0

    def __post_init__(self) -> None:
        if isinstance(self.scale, bool) or not (isinstance(self.scale, (int, float)) and 0 < self.scale < math.inf):
            raise ConfigError(f"scale = {self.scale!r} must be a positive number, such as 0.001 for millimetres")
        if self.up is not None:
            unit_vector(self.up, name="up")


def frame_up(frame: str) -> tuple[float, float, float] | None:
    """Where up is in a frame of this name: "world" has it along z, in a "camera"'s frame it is not known.

    Raises ConfigError for another name.
    """
    if frame not in ("camera", "world"):
        raise ConfigError(f"frame = {frame!r} must be camera or world; up=[x,y,z] says anything else")
    return (0.0, 0.0, 1.0) if frame == "world" else None


def cloud_paths(path: str | os.PathLike[str]) -> list[Path]:
    """The file itself, or all files of a folder that are clouds by their suffix, by name.

    Raises FileNotFoundError where there is nothing, CloudError for a folder without a cloud.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"cloud {path} does not exist")
    if not path.is_dir():
        return [path]
    found = sorted(each for each in path.iterdir() if each.suffix.lower() in SUFFIXES and each.is_file())
    if not found:
        raise CloudError(f"{path}: no file of this folder ends in {', '.join(SUFFIXES)}")
    return found


def plan_file(path: Path, task: Task) -> PlannedFile:
    """Read a file and plan on what is in it. Never raises for what the file holds."""
    started = time.perf_counter()
    try:
        cloud = read_cloud(path) * np.float32(task.scale)
        points = valid_points(cloud)
        read_s = time.perf_counter() - started
        _check_size(points, task)
    except (CloudError, OSError) as error:
        return PlannedFile(path, error=str(error).removeprefix(f"{path}: "))
    if task.segmenter is None:
        return PlannedFile(path, len(points), [_plan(task, path.name, points, None, None)], read_s=read_s)
    started = time.perf_counter()
    try:
        scene = task.segmenter.segment(cloud, up=task.up)
    except CloudError as error:
        return PlannedFile(path, len(points), read_s=read_s, error=str(error))
    segment_s = time.perf_counter() - started
    objects = [
        replace(
            _plan(task, f"object {k + 1}", scene.objects[k], scene.plane, others),
            surroundings=_surroundings(cloud, scene, k),
            cut_off=scene.touches_border[k],
        )
        for k, others in enumerate(_neighbours(scene))
    ]
    rest = np.ones(cloud.size // 3, dtype=bool)
    rest[np.concatenate([np.empty(0, dtype=np.int64), *scene.indices])] = False
    others = valid_points(cloud.reshape(-1, 3)[rest])
    return PlannedFile(path, len(points), objects, scene, others, read_s, segment_s)


def _check_size(points: NDArray, task: Task) -> None:
    """Raises CloudError with the setting to change for a cloud whose size speaks of other units, or of a scene."""
    if not len(points):
        raise CloudError("it holds no valid point")
    if task.segmenter is None:
        span = float(np.ptp(points.astype(np.float64), axis=0).max())
        if span > LARGEST_OBJECT:
            raise CloudError(
                f"spans {span:.4g} m, too much for an object: say scale=0.001 if these are millimetres, "
                "scene=true if this is a whole scene"
            )
    else:
        distance = float(np.median(np.linalg.norm(points.astype(np.float64), axis=1)))
        if distance > FARTHEST_SCENE:
            raise CloudError(f"half of its points are beyond {distance:.4g} m: say scale=0.001 for millimetres")


def _neighbours(scene: Scene) -> Iterable[NDArray | None]:
    for k in range(len(scene.objects)):
        others = [points for i, points in enumerate(scene.objects) if i != k] + scene.obstacles
        yield np.vstack(others) if others else None


def _surroundings(cloud: NDArray, scene: Scene, k: int) -> NDArray:
    """The points that are not object k's, yet near to it."""
    points = cloud.reshape(-1, 3)
    low, high = scene.objects[k].min(axis=0) - SURROUNDINGS, scene.objects[k].max(axis=0) + SURROUNDINGS
    near = ((points >= low) & (points <= high)).all(axis=1)
    near[scene.indices[k]] = False
    return points[near]


def _plan(task: Task, name: str, points: NDArray, table: NDArray | None, obstacles: NDArray | None) -> PlannedObject:
    started = time.perf_counter()
    try:
        plan, error = task.planner.plan(points, up=task.up, table=table, obstacles=obstacles), None
    except (CloudError, ConfigError) as problem:
        plan, error = GraspPlan(None, [], [], str(problem)), str(problem)
    return PlannedObject(name, points, plan, time.perf_counter() - started, error=error)


def plan_files(
    paths: Sequence[Path], task: Task, output: Path, say: Callable[[str], None] = print, command: str = ""
) -> dict[str, Any]:
    """Plan on each file; say a table; leave `results.json` and `plan.html` in the folder, and return the results."""
    say(_line("cloud", "points", "width", "score", "kind", "position m", "time"))
    files = []
    for path in paths:
        files.append(plan_file(path, task))
        for line in table_lines(files[-1]):
            say(line)
    output.mkdir(parents=True, exist_ok=True)
    results = as_results(files, task)
    _write(output / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")
    _write(output / "plan.html", plan_page(files, task.gripper, type(task.planner).__name__, task.up, command))
    return results


def table_lines(file: PlannedFile) -> list[str]:
    """The file's rows of the table for people."""
    if file.error is not None:
        return [_line(file.path.name, _count(file.n_points)) + f"  error: {file.error}"]
    lines = []
    if file.scene is not None:
        lines.append(_line(file.path.name, _count(file.n_points)) + f"  {file.found}, {1e3 * file.segment_s:.1f} ms")
    for each in file.objects:
        name = f"  {each.name}" if file.scene is not None else each.name
        ms, best = f"{1e3 * each.plan_s:.1f} ms", each.plan.best
        if best is None:
            word = "error" if each.error else "no grasp"
            start = _line(name, f"{len(each.points):,}")
            lines.append("  ".join([start, f"{word}: {each.plan.reason}, {ms}", *each.remarks]))
            continue
        position = " ".join(f"{value:6.3f}" for value in best.pose[:3, 3].round(3) + 0.0)  # no -0.000
        row = (f"{len(each.points):,}", f"{1e3 * best.width:.0f} mm", f"{best.score:.2f}", best.kind, position, ms)
        lines.append("  ".join([_line(name, *row), *each.remarks]))
    return lines


def _count(n_points: int | None) -> str:
    return "" if n_points is None else f"{n_points:,}"


def _line(
    name: str, points: str = "", width: str = "", score: str = "", kind: str = "", position: str = "", ms: str = ""
) -> str:
    name = name if len(name) <= 28 else "…" + name[-27:]
    return f"{name:28} {points:>9} {width:>7} {score:>6}  {kind:9} {position:>20} {ms:>8}".rstrip()


def as_results(files: Sequence[PlannedFile], task: Task) -> dict[str, Any]:
    """What `results.json` holds: only lists, mappings, numbers, words and None."""
    objects = [each for file in files for each in file.objects]
    return {
        "summary": {
            "files": len(files),
            "failed": sum(file.failed for file in files),
            "objects": len(objects),
            "with_grasp": sum(each.plan.best is not None for each in objects),
        },
        "gripper": asdict(task.gripper),
        "planner": type(task.planner).__name__,
        "up": None if task.up is None else [float(value) for value in np.asarray(task.up)],
        "scale": task.scale,
        "files": [
            {
                "file": str(file.path),
                "error": file.error,
                "points": file.n_points,
                "read_ms": 1e3 * file.read_s,
                "segment_ms": None if file.scene is None else 1e3 * file.segment_s,
                "table": None if file.scene is None or file.scene.plane is None else file.scene.plane.tolist(),
                "rejected": [] if file.scene is None else [asdict(each) for each in file.scene.rejected],
                "objects": [_object(each) for each in file.objects],
            }
            for file in files
        ],
    }


def _object(each: PlannedObject) -> dict[str, Any]:
    return {
        "name": each.name,
        "points": len(each.points),
        "cut_off": each.cut_off,
        "plan_ms": 1e3 * each.plan_s,
        "error": each.error,
        "reason": each.plan.reason,
        "grasps": [_grasp(grasp) for grasp in each.plan.candidates],
        "regions": [
            {
                "primitive": region.primitive,
                "verdict": region.verdict,
                "width": _finite(region.width),
                "curvature": _finite(region.curvature),
                "points": len(region.points),
                "slab": int(region.slab),
                "cluster": None if region.cluster is None else int(region.cluster),
            }
            for region in each.plan.regions
        ],
    }


def _grasp(grasp: Grasp) -> dict[str, Any]:
    return {
        "pose": np.asarray(grasp.pose, dtype=float).tolist(),
        "width": float(grasp.width),
        "score": float(grasp.score),
        "kind": grasp.kind,
        "region": None if grasp.region is None else int(grasp.region),
        "terms": {name: _finite(value) for name, value in grasp.terms.items()},
    }


def _finite(value: float) -> float | None:
    """JSON has no word for NaN and infinity."""
    return float(value) if math.isfinite(value) else None


def _write(path: Path, text: str) -> None:
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)
