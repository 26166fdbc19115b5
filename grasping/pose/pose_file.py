"""Poses of known objects in a file: a table, `results.json`, and a page with the models' outlines over the cloud."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Sequence
from importlib.resources import files as package_files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from grasping.cloud_files import read_cloud, valid_points
from grasping.errors import CloudError
from grasping.pose.object_pose import ObjectPose
from grasping.pose.outline import outline
from grasping.pose.pose_estimator import PoseEstimator
from grasping.segmentation.segmenter import Segmenter
from grasping.viewer.figure import Layer, fragment
from grasping.viewer.html import page, templates

FloatArray = NDArray[np.float64]

# Distances of the cloud from the models, m, up to which points have a colour: from green to red.
_STEPS = ((0.002, (31, 161, 135)), (0.005, (138, 176, 60)), (0.010, (224, 160, 30)), (np.inf, (200, 60, 50)))
_MODEL_RGB, _OUTLINE_RGB = (150, 170, 215), (30, 60, 150)
HEADER = f"{'model':28} {'class':16} {'on it':>6} {'residual':>9}  {'position m':>20}  left open"


def estimate_file(
    path: Path,
    estimator: PoseEstimator,
    output: Path,
    *,
    scene: bool = False,
    scale: float = 1.0,
    viewpoint: ArrayLike | None = None,
    say: Callable[[str], None] = print,
    command: str = "",
) -> dict[str, Any]:
    """Find the estimator's models in a file's cloud, say a table, leave `results.json` and `poses.html` in a folder.

    scene: the file is a whole frame, with its table; else it is a cut-out of known things. scale: metres in a unit of
    the file. viewpoint: (3,) where the camera stood, m; None: the origin. Raises CloudError and OSError for a file.
    """
    cloud = read_cloud(path) * np.float32(scale)
    points = valid_points(cloud).astype(np.float64)
    if not len(points):
        raise CloudError(f"{path}: it holds no valid point")
    started = time.perf_counter()
    if scene:
        # A frame is searched as it is; a loose cloud has its table found first.
        whole = cloud.ndim == 3
        poses = estimator.estimate(cloud if whole else Segmenter().segment(cloud), viewpoint=viewpoint)
    else:
        poses = estimator.estimate(points, viewpoint=viewpoint)
    seconds = time.perf_counter() - started
    results = {
        "file": str(path),
        "points": len(points),
        "models": [{"name": model.name, "class": model.label} for model in estimator.models],
        "estimate_ms": 1e3 * seconds,
        "reason": estimator.reason,
        "poses": [as_results(pose) for pose in poses],
    }
    output.mkdir(parents=True, exist_ok=True)
    eye = np.zeros(3) if viewpoint is None else np.asarray(viewpoint, np.float64)
    _write(output / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")
    _write(output / "poses.html", pose_page(path.name, points, poses, estimator.reason, eye, command))
    say(HEADER)
    for pose in poses:
        row = f"{pose.model.name[:28]:28} {pose.model.label[:16]:16} {pose.inlier_share:6.0%}"
        say(f"{row} {1e3 * pose.residual:6.1f} mm  {_position(pose):>20}  {pose.ambiguous}")
    if estimator.reason:
        say(f"{'no pose' if not poses else 'beyond them'}: {estimator.reason}")
    return results


def as_results(pose: ObjectPose) -> dict[str, Any]:
    """What `results.json` says of a pose."""
    return {
        "model": pose.model.name,
        "class": pose.model.label,
        "T_camera_object": pose.T_camera_object.tolist(),
        "inlier_share": pose.inlier_share,
        "residual": pose.residual,
        "left_open": str(pose.ambiguous),
        "ambiguous": bool(pose.ambiguous),
    }


def pose_page(
    name: str, points: FloatArray, poses: Sequence[ObjectPose], reason: str, eye: FloatArray, command: str = ""
) -> str:
    """A self-contained HTML document. points: (N, 3) of the cloud; eye: (3,) where it was seen from, m."""
    layers: list[Layer] = []
    if poses:
        placed = [pose.model.points @ pose.T_camera_object[:3, :3].T + pose.T_camera_object[:3, 3] for pose in poses]
        off = np.min(
            [
                np.abs(_plane_distance(points, at, pose.model.normals @ pose.T_camera_object[:3, :3].T))
                for pose, at in zip(poses, placed, strict=True)
            ],
            axis=0,
        )
        before = 0.0
        for to, rgb in _STEPS:
            some = points[(off >= before) & (off < to)]
            words = f"{1e3 * before:.0f} to {1e3 * to:.0f} mm off" if np.isfinite(to) else f"over {1e3 * before:.0f} mm"
            if len(some):
                layers.append(Layer(some, words, group="Residuals", rgb=rgb, framed=np.isfinite(to)))
            before = to
        for pose, at in zip(poses, placed, strict=True):
            lines = outline(pose.model, pose.T_camera_object, eye)
            layers.append(Layer(lines, f"{pose.model.name}, outline", group="Residuals", rgb=_OUTLINE_RGB))
            layers.append(Layer(at, pose.model.name, (f"{pose.inlier_share:.0%} on it",), "Models", _MODEL_RGB))
    figure = fragment(cloud=points, layers=layers, max_points=40_000)
    body = templates("grasping.pose").get_template("poses.html")
    count = f"{len(poses)} known object{'s' * (len(poses) != 1)} found."
    return page(
        f"Poses in {name}",
        body.render(
            title=f"Poses in {name}",
            summary=count,
            command=command,
            poses=poses,
            reason=reason,
            figure=figure,
            position=_position,
            matrix=lambda pose: "\n".join(" ".join(f"{v:9.5f}" for v in row) for row in pose.T_camera_object),
        ),
        style=(package_files("grasping.plan_files") / "page.css").read_text(encoding="utf-8"),
    )


def _plane_distance(points: FloatArray, surface: FloatArray, normals: FloatArray) -> FloatArray:
    """Of points (N, 3) from a sampled surface (M, 3): along its normal, beyond its rim from its nearest point."""
    distance, nearest = cKDTree(surface).query(points)
    along = np.abs(np.einsum("ij,ij->i", points - surface[nearest], normals[nearest]))
    spacing = float(np.median(cKDTree(surface).query(surface, k=2)[0][:, 1]))
    return np.where(distance < 1.5 * spacing, along, distance)


def _position(pose: ObjectPose) -> str:
    return " ".join(f"{value:.3f}" for value in pose.T_camera_object[:3, 3].round(3) + 0.0)  # no -0.000


def _write(path: Path, text: str) -> None:
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(text, encoding="utf-8")
    os.replace(temporary, path)
