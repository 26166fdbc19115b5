"""Numbers of a figure: points packed into text, how large they are drawn, and where the eye stands."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from grasping.errors import CloudError
from grasping.grasp import Grasp

FIELD_OF_VIEW = math.radians(28)  # of the shorter side of a picture


def thinned(points: np.ndarray, limit: int) -> np.ndarray:
    """Some of the points, drawn at random: every n-th of a frame in raster order would show stripes."""
    if len(points) <= limit:
        return points
    return points[np.random.default_rng(0).choice(len(points), limit, replace=False)]


def packed(points: np.ndarray) -> dict[str, Any]:
    """Coordinates as uint16 over their bounding box: 6 bytes a point, 15 µm steps over a metre."""
    if not len(points):
        return {"xyz": "", "origin": [0, 0, 0], "step": [0, 0, 0]}
    origin = points.min(axis=0)
    step = np.maximum(np.ptp(points, axis=0) / 65535, 1e-12)
    codes = np.rint((points - origin) / step).astype("<u2")
    return {"xyz": base64.b64encode(codes.tobytes()).decode(), "origin": origin.tolist(), "step": step.tolist()}


def disc_radius(points: np.ndarray, scene_radius: float) -> float:
    """Of discs that just close the surface, metres."""
    if len(points) < 5:
        return round(scene_radius / 60, 6)
    sample = points[:: max(1, len(points) // 400)]
    # To the fourth neighbour it is as far as one point needs room, in a camera's raster as in a random choice of it.
    spacing = float(np.median(cKDTree(points).query(sample, k=5)[0][:, 4]))
    return round(float(np.clip(0.75 * spacing, scene_radius / 400, scene_radius / 40)), 6)


def unit_up(up: Sequence[float] | np.ndarray | None) -> np.ndarray:
    axis = np.array([0.0, -1.0, 0.0]) if up is None else np.asarray(up, dtype=np.float64)
    if axis.shape != (3,) or not np.isfinite(axis).all() or np.linalg.norm(axis) < 1e-9:
        raise CloudError(f"up must be a finite vector of three numbers, not {up!r}")
    return axis / np.linalg.norm(axis)


def eye_direction(grasp: Grasp | None, target: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Unit vector from the target to the viewer: along the finger's hinge axis, so that the closing shows, from above.

    Of the two sides the one towards the frame's origin, where a depth camera saw the points from.
    """
    sideways = grasp.pose[:3, 1] if grasp is not None else -target
    flat = sideways - (sideways @ up) * up
    if np.linalg.norm(flat) < 1e-6:
        flat = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    if flat @ -target < 0:
        flat = -flat
    direction = 0.82 * flat / np.linalg.norm(flat) + 0.57 * up
    return direction / np.linalg.norm(direction)


def fitting_distance(extent: np.ndarray, eye: np.ndarray, up: np.ndarray) -> float:
    """From the eye to the target so that all of the extent (M, 3), about the target, is in a square picture, metres."""
    right = np.cross(up, eye)  # the eye is never above the target: see `eye_direction`
    right /= np.linalg.norm(right)
    aside = np.maximum(np.abs(extent @ right), np.abs(extent @ np.cross(eye, right)))
    return max(1.05 * float((extent @ eye + aside / math.tan(FIELD_OF_VIEW / 2)).max()), 0.05)


def rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), 5) for value in np.asarray(values).ravel()]
