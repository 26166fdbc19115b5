"""What a depth camera sees of a table at z = 0 with upright cans, computed ray by ray."""

import numpy as np

from pecgrasp_env.real import DepthImage
from pecgrasp_env.sensor.intrinsics import intrinsics_of

CAMERA = intrinsics_of("424x240")


def table_with(things, T_base_camera, noise=0.0005):
    """Depth image of cans (x, y, radius, height), m, by a camera at T_base_camera (4, 4)."""
    T, eye = T_base_camera, T_base_camera[:3, 3]
    v, u = np.indices((CAMERA.height, CAMERA.width)) + 0.5
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1) @ T[:3, :3].T
    depth = -eye[2] / rays[..., 2]
    for x, y, radius, height in things:
        top = (height - eye[2]) / rays[..., 2]
        hit = eye[:2] + top[..., None] * rays[..., :2] - (x, y)
        depth = np.where((np.linalg.norm(hit, axis=-1) < radius) & (top < depth), top, depth)
        from_middle = eye[:2] - (x, y)
        a, b = (rays[..., :2] ** 2).sum(axis=-1), (rays[..., :2] * from_middle).sum(axis=-1)
        inside = b**2 - a * (from_middle @ from_middle - radius**2)
        side = (-b - np.sqrt(np.maximum(inside, 0))) / a
        z = eye[2] + side * rays[..., 2]
        depth = np.where((inside > 0) & (z > 0) & (z < height) & (side < depth), side, depth)
    depth += noise * np.random.default_rng(round(1e6 * eye.sum())).standard_normal(depth.shape)
    return DepthImage(depth.astype(np.float32), CAMERA, 0.0)
