"""Each method on each cloud, the whole frames, one row of results at a time: a stopped run goes on."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from grasping.pose.depth_image import depth_image
from grasping.pose.metrics import add, add_s, mssd, vsd
from grasping.pose.object_model import ObjectModel
from grasping.pose.object_pose import ObjectPose
from grasping.pose.pose_estimator import PoseEstimator
from pecgrasp_env.experiments.known_poses.cases import CloudCase, FrameCase
from pecgrasp_env.experiments.known_poses.methods import Method, method

VSD_TAU, VSD_LEAST = 0.02, 0.3  # m, and the discrepancy up to which a pose is right by what is to be seen (BOP 2018)
VISIBLE = 0.5  # of an object, from which on it must be found in a frame
RIGHT = 0.1  # of the diameter: the greatest distance of a point (MSSD) at which a pose is right


class Rows:
    """Results on disk, a line each, by the case and the method."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.rows: list[dict[str, Any]] = []
        if file.exists():
            lines = file.read_text().splitlines()
            self.rows = [json.loads(line) for line in lines if line.endswith("}")]
        self._done = {(row["case"], row["method"]) for row in self.rows}

    def has(self, case: str, method: str) -> bool:
        return (case, method) in self._done

    def add(self, row: dict[str, Any]) -> None:
        self.rows.append(row)
        self._done.add((row["case"], row["method"]))
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.open("a") as out:
            out.write(json.dumps(row) + "\n")


def run_clouds(
    group: str, cases: Sequence[CloudCase], methods: Sequence[str], rows: Rows, progress: Callable[[int, int], None]
) -> None:
    """Every method on every cut-out, the model known; what is done already is passed over."""
    prepared: dict[tuple[str, str], Method] = {}
    for done, case in enumerate(cases, 1):
        for name in methods:
            if rows.has(case.name, name):
                continue
            key = (name, case.model.name)
            if key not in prepared:
                prepared[key] = method(name, case.model)
            start = time.perf_counter()
            T = prepared[key](case.points)
            seconds = time.perf_counter() - start
            rows.add(
                {
                    "group": group,
                    "case": case.name,
                    "method": name,
                    "object": case.model.name,
                    "occlusion": case.occlusion,
                    "points": len(case.points),
                    "seconds": seconds,
                    **errors(case.model, T, case.T_true),
                }
            )
        progress(done, len(cases))


def errors(model: ObjectModel, T: np.ndarray | None, T_true: np.ndarray) -> dict[str, Any]:
    """All measures of a pose, m, shares of the diameter in their own; None each where there is no pose."""
    if T is None:
        return dict.fromkeys(("add", "add_s", "add_either", "mssd", "median"), None) | {"diameter": model.diameter}
    whole, seen_as = add(model.points, T, T_true), add_s(model.points, T, T_true)
    off = np.linalg.norm(model.points @ (T[:3, :3] - T_true[:3, :3]).T + T[:3, 3] - T_true[:3, 3], axis=1)
    return {
        "add": whole,
        "add_s": seen_as,
        "add_either": whole if model.symmetry.is_trivial else seen_as,
        "mssd": mssd(model.points, T, T_true, model.symmetry),
        "median": float(np.median(off)),
        "diameter": model.diameter,
    }


def frame_errors(case: FrameCase, model: ObjectModel, pose: ObjectPose, k: int) -> dict[str, float]:
    """How far a pose is from object k of the frame: MSSD as a share of the diameter, of the pose itself (`off`) and the
    least of it and those that the view leaves open beside it (`off_open`); VSD at 20 mm (`vsd`).
    """
    T_true = case.T_true[k]
    poses = (pose.T_camera_object, *pose.ambiguous.others)
    off = [mssd(model.points, T, T_true, model.symmetry) / model.diameter for T in poses]
    estimated, true = (
        depth_image(model.vertices, model.faces, T, case.camera, case.labels.shape) for T in (poses[0], T_true)
    )
    measured = np.nan_to_num(case.cloud[..., 2])
    (seen,) = vsd(measured, estimated, true, case.camera, model.diameter, taus=[VSD_TAU / model.diameter])
    return {"off": off[0], "off_open": min(off), "vsd": float(seen)}


def run_frames(
    group: str,
    models: Sequence[ObjectModel],
    cases: Iterable[FrameCase],
    rows: Rows,
    progress: Callable[[int, int], None],
    total: int,
) -> None:
    """All models at once in whole frames without cut-outs; a row a frame. total: how many frames there are."""
    estimator = PoseEstimator(models)
    by_name = {model.name: model for model in models}
    for done, case in enumerate(cases, 1):
        if not rows.has(case.name, "geometry"):
            start = time.perf_counter()
            poses = estimator.estimate(case.cloud)
            seconds = time.perf_counter() - start
            labels = case.labels.reshape(-1)
            objects: list[dict[str, Any]] = [
                {"name": name, "visible": float(seen), "off": None, "off_open": None, "vsd": None, "given": None}
                for name, seen in zip(case.names, case.visible, strict=True)
            ]
            on_nothing = 0
            for pose in poses:
                # What it is a pose of: the object that most of its points lie on.
                counts = np.bincount(labels[pose.indices[pose.indices >= 0]], minlength=len(objects) + 1)
                shown = int(counts[1:].argmax()) if len(counts) > 1 and counts[1:].any() else None
                if shown is None:
                    on_nothing += 1
                    continue
                objects[shown]["given"] = pose.model.name
                for k, name in enumerate(case.names):
                    if name == pose.model.name:
                        for key, value in frame_errors(case, by_name[name], pose, k).items():
                            before = objects[k][key]
                            objects[k][key] = value if before is None else min(value, before)
            rows.add(
                {
                    "group": group,
                    "case": case.name,
                    "method": "geometry",
                    "kind": case.kind,
                    "seconds": seconds,
                    "on_nothing": on_nothing,
                    "objects": objects,
                }
            )
        progress(done, total)
