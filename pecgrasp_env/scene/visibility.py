"""What hides an object, exactly: seen from a camera, and seen from straight above.

Meshes are drawn one by one into a buffer of the nearest surface. That takes NumPy alone and a few milliseconds a scene,
so that a task knows what hides what in every mode of observation, without a renderer.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sapien
import trimesh
from scipy.spatial.transform import Rotation

from pecgrasp_env.objects import ObjectModel
from pecgrasp_env.sensor.intrinsics import CameraIntrinsics

Mesh = tuple[np.ndarray, np.ndarray]  # vertices (V, 3) m, world frame; faces (F, 3)

_CELL_M = 0.002  # of the view from above
_ABOVE_M = 0.001  # one surface is above another by more than contact and rounding
_LEAST_OVERLAP_M2 = 1e-4  # seen from above, from which an object lies on another: a fingertip's breadth


def placed_mesh(model: ObjectModel, pose: np.ndarray) -> Mesh:
    """What is seen of an object at a pose (7,), m and quaternion wxyz."""
    starts = np.cumsum([0] + [len(part.vertices) for part in model.parts[:-1]])
    vertices = np.concatenate([part.vertices for part in model.parts])
    faces = np.concatenate([part.faces + start for part, start in zip(model.parts, starts, strict=True)])
    return Rotation.from_quat(np.roll(pose[3:], -1)).apply(vertices) + pose[:3], faces


def box_mesh(half_size: np.ndarray, pose: sapien.Pose) -> Mesh:
    """A box of half size (3,) m at a pose."""
    box = trimesh.creation.box(2 * np.asarray(half_size), pose.to_transformation_matrix())
    return np.asarray(box.vertices), np.asarray(box.faces)


def visible_shares(meshes: Sequence[Mesh], T_world_camera: np.ndarray, camera: CameraIntrinsics) -> np.ndarray:
    """Of each object the share of the pixels it would cover alone that nothing hides, (K,); 0 outside of the image.

    meshes: the objects, and behind them in the list what else may hide them; all in front of the camera.
    T_world_camera: (4, 4), OpenCV axes.
    """
    shape = (camera.height, camera.width)
    alone = []
    for vertices, faces in meshes:
        x, y, z = ((vertices - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]).T
        screen = np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy, 1 / z], axis=1)
        alone.append(nearest_surface(screen[faces], shape))
    front = np.max(alone, axis=0)
    seen = [np.count_nonzero((each == front) & np.isfinite(each)) for each in alone]
    covered = [np.count_nonzero(np.isfinite(each)) for each in alone]
    return np.divide(seen, covered, out=np.zeros(len(meshes)), where=np.array(covered) > 0)


def lying_on(meshes: Sequence[Mesh]) -> np.ndarray:
    """Which object lies on which, (K, K) bool: [i, j] where i is above j over at least 1 cm² seen from straight above,
    or above something that is so above j.
    """
    corners = np.concatenate([vertices[:, :2] for vertices, _ in meshes])
    low = corners.min(axis=0)
    columns, rows = (np.ceil((corners.max(axis=0) - low) / _CELL_M).astype(int) + 1).tolist()
    tops, undersides = [], []
    for vertices, faces in meshes:
        screen = np.concatenate([(vertices[:, :2] - low) / _CELL_M, vertices[:, 2:]], axis=1)
        tops.append(nearest_surface(screen[faces], (rows, columns)))
        undersides.append(-nearest_surface((screen * [1, 1, -1])[faces], (rows, columns)))
    result = np.zeros((len(meshes), len(meshes)), bool)
    for i, underside in enumerate(undersides):
        for j, top in enumerate(tops):
            if i != j:
                both = np.isfinite(underside) & np.isfinite(top)
                # By their middles, for what lies in a bowl is above the bowl's bottom and below its rim.
                own, other = underside[both] + tops[i][both], top[both] + undersides[j][both]
                result[i, j] = np.count_nonzero(own > other + 2 * _ABOVE_M) * _CELL_M**2 >= _LEAST_OVERLAP_M2
    for k in range(len(meshes)):
        result |= result[:, k, None] & result[k]
    np.fill_diagonal(result, False)
    return result


def nearest_surface(triangles: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """The greatest third coordinate at each pixel's centre, (H, W) float64, -inf where no triangle is.

    triangles: (F, 3, 3): column, row, and what is greater the nearer it is and affine in them: the inverse depth of a
        camera, the height of a view from above. Pixel (r, c) has its centre at column c + 0.5, row r + 0.5.
    """
    height, width = shape
    buffer = np.full(height * width, -np.inf)
    first = np.maximum(np.ceil(triangles[..., :2].min(axis=1) - 0.5), 0).astype(int)
    last = np.minimum(np.floor(triangles[..., :2].max(axis=1) - 0.5), (width - 1, height - 1)).astype(int)
    size = np.maximum(last - first + 1, 0)
    a, b, c = triangles.swapaxes(0, 1)
    twice_area = _cross(b - a, c - a)
    count = np.where(twice_area != 0, size.prod(axis=1), 0)
    # One entry for each pixel of each triangle's box; most triangles are small and lie between pixels' centres.
    face = np.repeat(np.arange(len(triangles)), count)
    within = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    column = first[face, 0] + within % size[face, 0]
    row = first[face, 1] + within // size[face, 0]
    centre = np.stack([column + 0.5, row + 0.5], axis=1)
    at_b = _cross(centre - a[face, :2], (c - a)[face]) / twice_area[face]
    at_c = _cross((b - a)[face], centre - a[face, :2]) / twice_area[face]
    inside = (at_b >= 0) & (at_c >= 0) & (at_b + at_c <= 1)
    value = a[face, 2] + at_b * (b - a)[face, 2] + at_c * (c - a)[face, 2]
    np.maximum.at(buffer, (row * width + column)[inside], value[inside])
    return buffer.reshape(shape)


def _cross(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """z component of the cross products of (N, 2 or more) vectors."""
    return p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
