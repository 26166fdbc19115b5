"""What the camera saw, as an image of depths whose pixels leave no gaps in the cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]

WIDER = 1.5  # than the distance of neighbours in the picture: every pixel inside the cloud then has a point
MEASURED = 400  # points by which their distance is told
MOST_PIXELS = 1024  # along a side
NEAREST = 1e-3  # m: what is closer to the eye is not in the picture


@dataclass(frozen=True)
class View:
    """near, far: (h, w) least and greatest depth of a pixel's points, m; infinity and 0 where there is none.

    T_view_scene: (4, 4) into the frame of a camera at the eye whose z axis points to the cloud. A point at x / z, y / z
    is in column (x / z − left) / pitch and row (y / z − top) / pitch.
    """

    near: FloatArray
    far: FloatArray
    T_view_scene: FloatArray
    left: float
    top: float
    pitch: float

    @staticmethod
    def of(points: FloatArray, eye: FloatArray, pitch: float | None = None) -> View:
        """The picture of a cloud (N, 3) from the eye (3,)."""
        T = looking(eye, points.mean(axis=0))
        local = points @ T[:3, :3].T + T[:3, 3]
        local = local[local[:, 2] > NEAREST]
        if not len(local):
            return View(np.full((1, 1), np.inf), np.zeros((1, 1)), T, 0.0, 0.0, 1.0)
        plane = local[:, :2] / local[:, 2:]
        if pitch is None:
            # Among those about the middle, as a tree of all would take longer than the rest.
            off = np.square(plane - np.median(plane, axis=0)).sum(axis=1)
            about = plane[np.argpartition(off, MEASURED)[:MEASURED]] if len(plane) > MEASURED else plane
            pitch = WIDER * float(np.median(cKDTree(about).query(about, k=2)[0][:, 1])) if len(plane) > 1 else 1e-3
        low, high = plane.min(axis=0), plane.max(axis=0)
        pitch = max(pitch, float((high - low).max()) / (MOST_PIXELS - 4), 1e-6)
        left, top = low - 1.5 * pitch
        w, h = np.floor((high - [left, top]) / pitch).astype(int) + 2
        column, row = np.floor((plane - [left, top]) / pitch).astype(int).T
        near, far = np.full((h, w), np.inf), np.zeros((h, w))
        np.minimum.at(near, (row, column), local[:, 2])
        np.maximum.at(far, (row, column), local[:, 2])
        return View(near, far, T, float(left), float(top), float(pitch))


def looking(eye: FloatArray, at: FloatArray) -> FloatArray:
    """T_view_scene (4, 4) of a camera at the eye whose z axis points to `at`."""
    z = at - eye
    length = float(np.linalg.norm(z))
    z = z / length if length > 1e-9 else np.array([0.0, 0.0, 1.0])
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.stack([x, np.cross(z, x), z])
    T[:3, 3] = -T[:3, :3] @ eye
    return T
