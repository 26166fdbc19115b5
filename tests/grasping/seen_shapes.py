"""Shapes of which cameras see the near side: clouds with known poses, and rough ones, for fusing."""

import numpy as np
from scipy.spatial.transform import Rotation

from grasping.fusion.icp import moved

Shape = tuple[np.ndarray, np.ndarray]  # points and outward normals, (N, 3)


def box(n: int, size: tuple, rng: np.random.Generator, at: tuple = (0.0, 0.0, 0.0)) -> Shape:
    sides = np.asarray(size, float)
    areas = np.repeat([sides[1] * sides[2], sides[0] * sides[2], sides[0] * sides[1]], 2)
    face = rng.choice(6, n, p=areas / areas.sum())
    sign = np.where(face % 2, 0.5, -0.5)
    unit, normals = rng.uniform(-0.5, 0.5, (n, 3)), np.zeros((n, 3))
    unit[np.arange(n), face // 2] = sign
    normals[np.arange(n), face // 2] = np.sign(sign)
    return unit * sides + at, normals


def box_with_handle(rng: np.random.Generator) -> Shape:
    body, handle = box(3200, (0.10, 0.06, 0.08), rng), box(800, (0.07, 0.02, 0.02), rng, (0.085, 0.0, 0.01))
    return np.vstack([body[0], handle[0]]), np.vstack([body[1], handle[1]])


def cylinder(rng: np.random.Generator, n: int = 4000, radius: float = 0.033, height: float = 0.10) -> Shape:
    angle, z = rng.uniform(0, 2 * np.pi, n), rng.uniform(-height / 2, height / 2, n)
    side, up = rng.random(n) < height / (height + radius), np.where(rng.random(n) < 0.5, 1.0, -1.0)
    at = np.where(side, radius, radius * np.sqrt(rng.random(n)))
    points = np.column_stack([at * np.cos(angle), at * np.sin(angle), np.where(side, z, up * height / 2)])
    flat = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    return points, np.where(side[:, None], flat, up[:, None] * [0.0, 0.0, 1.0])


def ball(rng: np.random.Generator, n: int = 4000, radius: float = 0.035) -> Shape:
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals * radius, normals


def camera(azimuth: float, elevation: float = 0.8, distance: float = 0.5) -> np.ndarray:
    """T_world_camera that looks at the origin."""
    away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    x = np.cross(-away, [0, 0, 1])
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(-away, x), -away])
    T[:3, 3] = distance * away
    return T


def seen(shape: Shape, T: np.ndarray, rng: np.random.Generator, noise: float = 0.0) -> np.ndarray:
    """What a camera at T_world_camera sees of it, in its own frame; noise along the rays, m."""
    points, normals = shape
    towards = T[:3, 3] - points
    front = np.einsum("ij,ij->i", towards, normals) > 0.1 * np.linalg.norm(towards, axis=1)
    own = (points[front] - T[:3, 3]) @ T[:3, :3]
    return own * (1 + rng.normal(size=(len(own), 1)) * noise / np.linalg.norm(own, axis=1, keepdims=True))


def jolt(rng: np.random.Generator, shift: float = 0.01, turn_deg: float = 3.0) -> np.ndarray:
    """An error of a pose: up to ±shift m along and ±turn about each axis."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(rng.uniform(-turn_deg, turn_deg, 3))).as_matrix()
    T[:3, 3] = rng.uniform(-shift, shift, 3)
    return T


def off(T: np.ndarray, expected: np.ndarray, points: np.ndarray) -> float:
    """How far the pose puts the farthest of the points from where it belongs, m."""
    return float(np.linalg.norm(moved(T, points) - moved(expected, points), axis=1).max())


def views_of(make, seed: int, noise: float, azimuths: tuple = (0.3, 0.7, 1.1)) -> tuple:
    """Clouds, true poses and rough poses; the first pose is exact. Each view has its own points, but without noise."""
    rng = np.random.default_rng(seed)
    same = make(rng)
    poses = [camera(azimuth) for azimuth in azimuths]
    clouds = [seen(make(rng) if noise else same, T, rng, noise) for T in poses]
    return clouds, poses, [poses[0]] + [jolt(rng) @ T for T in poses[1:]]
