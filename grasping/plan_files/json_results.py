"""What `results.json` says of files that were planned on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from grasping.grasp import Grasp
from grasping.plan_files.plan_file import Task
from grasping.plan_files.results import PlannedFile, PlannedObject


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
                "rejected": [] if file.scene is None else [each.as_results() for each in file.scene.rejected],
                "cuts": [] if file.scene is None else [asdict(each) for each in file.scene.cuts],
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
        "confidence": each.confidence,
        "plan_ms": 1e3 * each.plan_s,
        "error": each.error,
        "reason": each.plan.reason,
        "planned_on": each.plan.source,
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
