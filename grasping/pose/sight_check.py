"""What the camera would see of a model at a pose, against what it saw; the compiled kernel does the same, sooner."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from grasping.pose import kernels
from grasping.pose.view import NEAREST, View

FloatArray = NDArray[np.float64]

GRAZING = 0.2  # cosine: what is seen more aslant is often not measured
BUFFER = 64  # pixels along a side of the picture in which the model hides parts of itself
COARSER = 1.5  # than the model's points lie apart: its pixels
BEHIND = 2.0  # pixels of it that a point may lie behind the first and still be seen
STEEP = 0.35  # cosine, from which on a tolerance along the normal grows no longer along the line of sight
SEEN, CLEAR, HIDDEN, UNKNOWN = range(4)


def look(
    view: View,
    points: FloatArray,
    normals: FloatArray,
    spacing: float,
    diameter: float,
    T: FloatArray,
    tolerance: float,
) -> FloatArray:
    """Of each pose T_scene_object (H, 4, 4) how much of the model is … as the camera faces it, (H, 4), in points:

    measured where it lies; in front of all that was measured there, which is a contradiction; behind something; where
    nothing was measured. points, normals: (M, 3), object frame. spacing: of the points, m. tolerance: m, along normals.
    """
    T_view_object = np.ascontiguousarray(view.T_view_scene @ T)
    coarse = max(COARSER * spacing, diameter / (BUFFER - 8))
    sums = np.zeros((len(T), 4))
    if kernels.compiled is not None:
        kernels.compiled.look(
            *(view.near, view.far, view.left, view.top, view.pitch),
            *(points, normals, T_view_object, coarse, tolerance, sums),
        )
        return sums
    for number, P in enumerate(T_view_object):
        sums[number] = _look(view, points, normals, P, coarse, tolerance)
    return sums


def _look(
    view: View, points: FloatArray, normals: FloatArray, T: FloatArray, coarse: float, tolerance: float
) -> FloatArray:
    place = [T[i, 0] * points[:, 0] + T[i, 1] * points[:, 1] + T[i, 2] * points[:, 2] + T[i, 3] for i in range(3)]
    facing = [T[i, 0] * normals[:, 0] + T[i, 1] * normals[:, 1] + T[i, 2] * normals[:, 2] for i in range(3)]
    x, y, z = place
    middle = float(np.add.accumulate(z)[-1]) / len(z)
    far = np.sqrt(x * x + y * y + z * z)
    cosine = -(x * facing[0] + y * facing[1] + z * facing[2]) / np.maximum(far, NEAREST)
    faces = np.flatnonzero((cosine > GRAZING) & (z > NEAREST))
    counts = np.zeros(4)
    if not len(faces) or middle <= NEAREST:
        return counts
    u, v, z, cosine = x[faces] / z[faces], y[faces] / z[faces], z[faces], cosine[faces]
    pixel = coarse / middle
    left, top = u.min(), v.min()
    column = np.minimum(np.floor((u - left) / pixel), BUFFER - 1).astype(np.int64)
    row = np.minimum(np.floor((v - top) / pixel), BUFFER - 1).astype(np.int64)
    first = np.full((BUFFER, BUFFER), np.inf)
    np.minimum.at(first, (row, column), z)
    open_ = z <= first[row, column] + BEHIND * coarse
    u, v, z, cosine = u[open_], v[open_], z[open_], cosine[open_]
    slack = tolerance / np.maximum(cosine, STEEP)
    h, w = view.near.shape
    column = np.clip(np.floor((u - view.left) / view.pitch), -2, w + 1).astype(np.int64)
    row = np.clip(np.floor((v - view.top) / view.pitch), -2, h + 1).astype(np.int64)
    seen, nearer, farther = (np.zeros(len(u), dtype=bool) for _ in range(3))
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            r, c = row + down, column + right
            inside = (r >= 0) & (r < h) & (c >= 0) & (c < w)
            near = np.where(inside, view.near[np.where(inside, r, 0), np.where(inside, c, 0)], np.inf)
            most = np.where(inside, view.far[np.where(inside, r, 0), np.where(inside, c, 0)], 0.0)
            there = most > 0.0
            seen |= there & (near <= z + slack) & (most >= z - slack)
            nearer |= there & (near < z - slack)
            if down == 0 and right == 0:
                farther = there & (near > z + slack)
    kind = np.where(seen, SEEN, np.where(nearer, HIDDEN, np.where(farther, CLEAR, UNKNOWN)))
    for number in range(4):
        own = cosine[kind == number]
        counts[number] = float(np.add.accumulate(own)[-1]) if len(own) else 0.0
    return counts
