"""What a depth camera without noise measures of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

NEAREST = 1e-3  # m: faces that reach nearer to the camera are not drawn
_AT_ONCE = 1 << 21  # pixels of faces' boxes


def depth_image(
    vertices: FloatArray,
    faces: NDArray[np.int32],
    T_camera_object: FloatArray,
    K: FloatArray,
    shape: tuple[int, int],
) -> FloatArray:
    """Depth (H, W) along the optical axis, m, of a mesh (V, 3), (F, 3) at a pose; 0 where it is not.

    K: (3, 3), pixel centres at whole numbers. T_camera_object: (4, 4), camera frame x right, y down, z forward. Faces
    are seen from both sides.
    """
    height, width = shape
    placed = vertices @ T_camera_object[:3, :3].T + T_camera_object[:3, 3]
    corners = placed[faces]
    corners = corners[corners[:, :, 2].min(axis=1) > NEAREST]
    image = np.full(height * width, np.inf)
    if len(corners):
        pixel = corners[:, :, :2] / corners[:, :, 2:] * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])
        low = np.maximum(np.ceil(pixel.min(axis=1)).astype(np.int64), 0)
        high = np.minimum(np.floor(pixel.max(axis=1)).astype(np.int64), (width - 1, height - 1))
        size = np.maximum(high - low + 1, 0)
        count = size[:, 0] * size[:, 1]
        some = np.flatnonzero(count)
        ends = np.cumsum(count[some])
        for block in np.split(some, np.searchsorted(ends, np.arange(_AT_ONCE, ends[-1] if len(ends) else 0, _AT_ONCE))):
            _draw(image, width, K, corners[block], pixel[block], low[block], size[block])
    return np.where(np.isfinite(image), image, 0.0).reshape(height, width)


def _draw(
    image: FloatArray,
    width: int,
    K: FloatArray,
    corners: FloatArray,
    pixel: FloatArray,
    low: NDArray[np.int64],
    size: NDArray[np.int64],
) -> None:
    """Faces (F, 3, 3) whose corners are in the pixels (F, 3, 2), each within a box from `low` of `size` (F, 2)."""
    count = size[:, 0] * size[:, 1]
    face = np.repeat(np.arange(len(count)), count)
    within = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    u = low[face, 0] + within % size[face, 0]
    v = low[face, 1] + within // size[face, 0]
    sides = []
    for k in range(3):
        a, b = pixel[face, k], pixel[face, (k + 1) % 3]
        sides.append((b[:, 0] - a[:, 0]) * (v - a[:, 1]) - (b[:, 1] - a[:, 1]) * (u - a[:, 0]))
    side = np.stack(sides)
    inside = (side >= 0).all(axis=0) | (side <= 0).all(axis=0)
    face, u, v = face[inside], u[inside], v[inside]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    away = np.einsum("ij,ij->i", normal, corners[:, 0])
    slope = normal[face, 0] * (u - K[0, 2]) / K[0, 0] + normal[face, 1] * (v - K[1, 2]) / K[1, 1] + normal[face, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        z = away[face] / slope
    # Seen along its plane a face has no depth of its own; its corners' depths bound it.
    bounds = corners[face, :, 2]
    z = np.where(np.isfinite(z), np.clip(z, bounds.min(axis=1), bounds.max(axis=1)), bounds.min(axis=1))
    np.minimum.at(image, v * width + u, z)
