"""Rendered scenes whose answer is known: boxes on a table, seen by a noisy camera."""

import numpy as np
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT, FOCAL = 424, 240, 212.0


def look_down(tilt_deg: float = 25.0, distance: float = 0.55) -> np.ndarray:
    """T_world_camera: the camera looks at the origin of the world, tilted against straight down (x right, y down)."""
    turn = Rotation.from_euler("x", 180 - tilt_deg, degrees=True).as_matrix()
    T = np.eye(4)
    T[:3, :3] = turn
    T[:3, 3] = -distance * turn[:, 2]
    return T


def render(boxes: list[tuple], T: np.ndarray, noise: float = 0.0015, seed: int = 0, table: bool = True) -> tuple:
    """Ray cast boxes (x, y, length, width, height, z0 = 0) and the plane z = 0: frame (H, W, 3), owner (H, W).

    Owners: −1 table or nothing, else the number of the box. noise: standard deviation of the depth at 0.6 m, m.
    """
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = np.stack([(u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL, np.ones_like(u)], axis=-1)
    world = rays @ T[:3, :3].T
    eye = T[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(world[..., 2] < 0, -eye[2] / world[..., 2], np.inf) if table else np.full(u.shape, np.inf)
        owner = np.full(u.shape, -1)
        for number, (x, y, length, width, height, *z0) in enumerate(boxes):
            base = z0[0] if z0 else 0.0
            low = np.array([x - length / 2, y - width / 2, base])
            high = np.array([x + length / 2, y + width / 2, base + height])
            a, b = (low - eye) / world, (high - eye) / world
            enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
            hit = (enter <= leave) & (enter > 0) & (enter < depth)
            depth, owner = np.where(hit, enter, depth), np.where(hit, number, owner)
    depth = np.where(depth < 3.0, depth, np.nan)
    depth = depth + np.random.default_rng(seed).normal(size=depth.shape) * noise * (depth / 0.6) ** 2
    return (rays * depth[..., None]).astype(np.float32), owner


def up_in(T: np.ndarray) -> np.ndarray:
    return T[:3, :3].T @ np.array([0.0, 0.0, 1.0])


def owners_of(scene, owner: np.ndarray) -> list[dict[int, float]]:
    """For each object the share of its points that belongs to each box."""
    flat = owner.reshape(-1)
    return [{int(box): float((flat[index] == box).mean()) for box in np.unique(flat[index])} for index in scene.indices]


def share_found(scene, owner: np.ndarray, box: int) -> float:
    """Of a box's pixels those in its one largest cluster."""
    flat = owner.reshape(-1)
    return max(((flat[index] == box).sum() for index in scene.indices), default=0) / (flat == box).sum()


BOXES = [(0.0, 0.0, 0.10, 0.05, 0.06), (0.15, 0.05, 0.06, 0.06, 0.10), (-0.15, -0.03, 0.12, 0.04, 0.03)]
