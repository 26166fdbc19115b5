"""Whether the camera is where its file says, without a board: the table and one object from several views.

With the right place all views show one table plane and one object in the base frame. How far they disagree is what a
grasp will be off; the planner's margins bear 4 mm. What is wrong alike in all views is not seen, so turn the hand about
the vertical between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from grasping import Segmenter, fuse
from pecgrasp_env.real.calibration.errors import CalibrationError
from pecgrasp_env.real.calibration.recorded_views import read_depth_views
from pecgrasp_env.robot.kinematics import UP
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics, deproject

MOST_SHIFT, MOST_TURN = 0.004, np.deg2rad(1.0)  # of the table
MOST_OBJECT_SHIFT, MOST_OBJECT_TURN = 0.006, np.deg2rad(6.0)  # a fist-sized thing is aligned to a quarter of that
_SAME_OBJECT = 0.08  # m between its middles in two views


@dataclass(frozen=True)
class ViewCheck:
    """table_mm, table_degrees: of the table in this view from that in all. object_mm, object_degrees: by how much the
    object had to be moved to lie on that of the first view; None: it could not be compared, and why.
    """

    name: str
    table_mm: float | None
    table_degrees: float | None
    object_mm: float | None
    object_degrees: float | None
    why: str | None = None


@dataclass(frozen=True)
class TouchUp:
    """words: what is wrong, in plain English; empty: the views agree. table_height: m, base frame."""

    views: list[ViewCheck]
    table_height: float
    words: list[str]

    def rows(self) -> list[tuple[str, ...]]:
        def shown(value: float | None, digits: int) -> str:
            return "–" if value is None else f"{value:.{digits}f}"

        return [
            (
                each.name,
                shown(each.table_mm, 1),
                shown(each.table_degrees, 2),
                shown(each.object_mm, 1),
                shown(each.object_degrees, 2),
            )
            for each in self.views
        ]

    def as_results(self) -> dict[str, Any]:
        return {
            "table_height": self.table_height,
            "views": [asdict(each) for each in self.views],
            "to_mend": self.words,
        }


def check_folder(folder: Path, T_parent_camera: np.ndarray, parent: str = "tool0") -> TouchUp:
    """A folder of depth images with poses (`recorded_views`). Raises CalibrationError."""
    intrinsics, views = read_depth_views(folder)
    poses = [view.T_base_tool0 @ T_parent_camera if parent == "tool0" else T_parent_camera for view in views]
    names, frames = [view.name for view in views], [view.image for view in views]
    return touch_up(names, frames, [intrinsics] * len(views), poses)


def touch_up(
    names: Sequence[str],
    frames: Sequence[np.ndarray],
    intrinsics: Sequence[CameraIntrinsics],
    T_base_camera: Sequence[np.ndarray],
) -> TouchUp:
    """frames: depth (H, W), m. One thing, such as a box that lies alone on the table, seen from two places at least.

    Raises CalibrationError where fewer than two views show a table.
    """
    segmenter = Segmenter()
    planes: dict[int, np.ndarray] = {}
    objects: dict[int, np.ndarray] = {}
    why: dict[int, str] = {}
    middle = None
    for k, (depth, camera, T) in enumerate(zip(frames, intrinsics, T_base_camera, strict=True)):
        scene = segmenter.segment(deproject(depth, camera), up=T[:3, :3].T @ UP)
        if scene.plane is None:
            why[k] = "no table is seen"
            continue
        normal = T[:3, :3] @ scene.plane[:3]
        planes[k] = np.append(normal, scene.plane[3] - normal @ T[:3, 3])
        middles = [T[:3, :3] @ points.mean(axis=0) + T[:3, 3] for points in scene.objects]
        if middle is None and middles:
            middle = middles[0]
        near = [np.linalg.norm(each - middle) for each in middles]
        if not near or min(near) > _SAME_OBJECT:
            why[k] = "the object of the first view is not seen"
        else:
            objects[k] = scene.objects[int(np.argmin(near))]
    if len(planes) < 2:
        raise CalibrationError(
            f"{len(planes)} of {len(frames)} views show a table, two are needed: {sorted(set(why.values()))}"
        )
    moved = _aligned(objects, T_base_camera, why)
    where = np.zeros(3) if middle is None else middle
    heights = {k: -(plane[3] + plane[:2] @ where[:2]) / plane[2] for k, plane in planes.items()}
    height = float(np.median(list(heights.values())))
    normal = np.mean([plane[:3] / np.linalg.norm(plane[:3]) for plane in planes.values()], axis=0)
    tilts = {k: _angle(plane[:3], normal) for k, plane in planes.items()}
    checks = [
        ViewCheck(
            name,
            1e3 * float(heights[k] - height) if k in heights else None,
            float(np.degrees(tilts[k])) if k in tilts else None,
            1e3 * moved[k][0] if k in moved else None,
            float(np.degrees(moved[k][1])) if k in moved else None,
            why.get(k),
        )
        for k, name in enumerate(names)
    ]
    return TouchUp(checks, height, _words(checks, height, _angle(normal, UP)))


def _aligned(
    objects: dict[int, np.ndarray], T_base_camera: Sequence[np.ndarray], why: dict[int, str]
) -> dict[int, tuple[float, float]]:
    """Of each view but the first how far its object was moved, m, and turned, rad, to fit."""
    order = sorted(objects)
    if len(order) < 2:
        return {}
    fused = fuse([objects[k] for k in order], poses=[T_base_camera[k] for k in order])
    found = {}
    for k, view in list(zip(order, fused.views, strict=True))[1:]:
        if view.reason is None:
            found[k] = (view.shift, view.turn)
        else:
            why[k] = view.reason
    return found


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def _words(checks: Sequence[ViewCheck], height: float, level: float) -> list[str]:
    words = []
    off = [abs(each.table_mm) for each in checks if each.table_mm is not None]
    tilt = [each.table_degrees for each in checks if each.table_degrees is not None]
    if max(off) > 1e3 * MOST_SHIFT or max(tilt) > np.degrees(MOST_TURN):
        words.append(
            f"the views see the table {max(off):.1f} mm and {max(tilt):.1f}° apart: calibrate the camera with a board"
        )
    if level > MOST_TURN:
        words.append(
            f"the table leans by {np.degrees(level):.1f}° in the base frame: does the robot stand upright on it?"
        )
    moved = [each.object_mm for each in checks if each.object_mm is not None]
    turned = [each.object_degrees for each in checks if each.object_degrees is not None]
    if moved and (max(moved) > 1e3 * MOST_OBJECT_SHIFT or max(turned) > np.degrees(MOST_OBJECT_TURN)):
        words.append(
            f"the views see the object {max(moved):.1f} mm and {max(turned):.1f}° apart: calibrate the camera with a "
            "board"
        )
    words += [f"{each.name}: {each.why}" for each in checks if each.why is not None]
    return words
