"""Convex things, and what a depth camera sees of them to the last digit: a ray meets a hull where its planes say."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from grasping.pose.object_model import ObjectModel, object_model

FLOOR = np.array([0.0, -0.8, -0.6, 0.42])  # n·p + d = 0, n up: a table 0.7 m ahead, seen from above
BACKS = {"flat back": 0.015, "long back": 0.07}  # m: two shapes that are one seen from before, and end elsewhere behind


def corners_of(shape: str) -> np.ndarray:
    """Corners (K, 3) of a shape, m; stones have no symmetry."""
    if shape == "box":
        return np.array([[x, y, z] for x in (-0.03, 0.03) for y in (-0.045, 0.045) for z in (-0.08, 0.08)])
    if shape in BACKS:
        ring = np.array([(0.05, 0.0), (0.02, 0.045), (-0.03, 0.03), (-0.045, -0.01), (0.01, -0.04)])
        front = np.array([(0.02, 0.01, -0.04), (-0.015, 0.0, -0.03), (0.0, -0.02, -0.025)])
        return np.concatenate(
            [front, *(np.column_stack([k * ring, np.full(5, z)]) for k, z in ((1, 0), (0.7, BACKS[shape])))]
        )
    if shape == "can":
        turn = np.arange(60) * (2 * np.pi / 60)
        ring = 0.035 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return np.concatenate([np.column_stack([ring, np.full(60, z)]) for z in (-0.05, 0.05)])
    seed = {"stone": 3, "pebble": 11}[shape]
    return np.random.default_rng(seed).normal(size=(8, 3)) * np.array([0.035, 0.025, 0.018])


@cache
def model_of(shape: str) -> ObjectModel:
    corners = corners_of(shape)
    hull = ConvexHull(corners)
    faces = hull.simplices.copy()
    a, b, c = (corners[faces[:, i]] for i in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return object_model(corners, faces, shape)


def on_table(seed: int, x: float, y: float, high: float) -> np.ndarray:
    """T_camera_object in any turn, the origin so high (m) above a place of FLOOR."""
    return pose(seed, tuple(np.array([x, y, (0.42 - 0.8 * y) / 0.6]) + high * FLOOR[:3]))


def pose(seed: int, at: tuple[float, float, float] = (0.0, 0.0, 0.6)) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    T[:3, 3] = at
    return T


def frame_of(
    things: list[tuple[str, np.ndarray]], table: np.ndarray | None = None, shape=(180, 240), focal: float = 270.0
) -> tuple[np.ndarray, np.ndarray]:
    """What is seen of shapes at T_camera_object: points (H, W, 3), NaN for nothing, and whose they are, or −1."""
    h, w = shape
    v, u = np.mgrid[:h, :w]
    rays = np.stack([(u - w / 2 + 0.5) / focal, (v - h / 2 + 0.5) / focal, np.ones(shape)], axis=-1)
    depth, owner = np.full(shape, np.inf), np.full(shape, -1)
    if table is not None:
        down = rays @ table[:3]
        depth = np.where(down < -1e-9, -table[3] / np.minimum(down, -1e-9), np.inf)
    for number, (name, T) in enumerate(things):
        planes = ConvexHull(corners_of(name)).equations
        normals = planes[:, :3] @ T[:3, :3].T
        offsets = planes[:, 3] - normals @ T[:3, 3]
        slope = rays @ normals.T
        meets = -offsets / np.where(np.abs(slope) > 1e-12, slope, 1e-12)
        near = np.where(slope < 0, meets, -np.inf).max(axis=-1)
        far = np.where(slope > 0, meets, np.inf).min(axis=-1)
        first = (near < far) & (near > 0) & (near < depth)
        depth[first], owner[first] = near[first], number
    points = rays * depth[..., None]
    points[~np.isfinite(depth)] = np.nan
    return points, owner


def cut_out(name: str, T: np.ndarray, **camera: object) -> np.ndarray:
    """(N, 3) of one shape alone."""
    points, owner = frame_of([(name, T)], **camera)  # type: ignore[arg-type]
    return points[owner == 0]


def off(model: ObjectModel, T: np.ndarray, true: np.ndarray) -> float:
    """Mean distance of the model's points at two poses, m."""
    return float(np.linalg.norm(model.points @ (T - true)[:3, :3].T + (T - true)[:3, 3], axis=1).mean())
