"""Inputs of the golden digests: analytic, seeded, and made by nothing that is tested.

Only the meshes of the catalogue come from the packages.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

WIDTH, HEIGHT, FOCAL = 424, 240, 212.0
UP = np.array([0.0, 0.0, 1.0])


# ----------------------------------------------------------------------------------------------------------- shapes


@dataclass(frozen=True)
class Solid:
    """kind: "box", "ball" or "can", upright on its centre of size (3,), turned by yaw about z; a can's is of no use."""

    kind: str
    centre: np.ndarray
    size: np.ndarray
    yaw: float = 0.0

    def hits(self, eye: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """(...,) at which multiple of each ray (..., 3) from eye (3,) the solid is met first; infinite where never."""
        turn = turn_about_z(self.yaw)
        eye, rays = (eye - self.centre) @ turn, rays @ turn
        half = self.size / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.kind == "box":
                return _between((-half - eye) / rays, (half - eye) / rays)
            if self.kind == "ball":
                return _quadric(eye, rays, np.ones(3), half[0])
            side = _quadric(eye, rays, np.array([1.0, 1.0, 0.0]), half[0])
            z = eye[2] + side * rays[..., 2]
            side = np.where(np.abs(z) <= half[2], side, np.inf)
            lid = (half[2] - eye[2]) / rays[..., 2]
            across = np.hypot(eye[0] + lid * rays[..., 0], eye[1] + lid * rays[..., 1])
            return np.minimum(side, np.where((across <= half[0]) & (lid > 0), lid, np.inf))


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


def _quadric(eye: np.ndarray, rays: np.ndarray, weights: np.ndarray, radius: float) -> np.ndarray:
    a, b = (weights * rays * rays).sum(axis=-1), (weights * eye * rays).sum(axis=-1)
    root = b * b - a * ((weights * eye * eye).sum() - radius * radius)
    first = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    return np.where((root >= 0) & (first > 0), first, np.inf)


def turn_about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def any_turn(rng: np.random.Generator) -> np.ndarray:
    """(3, 3) a random rotation."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def solids_on_table(rng: np.random.Generator, count: int) -> list[Solid]:
    """Boxes, balls and cans of a hand's size, that may touch or stand one in the other."""
    solids = []
    for _ in range(count):
        kind = str(rng.choice(["box", "ball", "can"]))
        size = rng.uniform(0.02, 0.10, 3) if kind == "box" else np.append([rng.uniform(0.03, 0.09)] * 2, 0.0)
        size[2] = size[0] if kind == "ball" else rng.uniform(0.02, 0.12)
        centre = np.append(rng.uniform(-0.18, 0.18, 2), size[2] / 2)
        solids.append(Solid(kind, centre, size, float(rng.uniform(0, np.pi))))
    return solids


# ---------------------------------------------------------------------------------------------------- camera frames


def camera(azimuth: float, elevation: float = 1.1, distance: float = 0.55) -> np.ndarray:
    """T_world_camera (4, 4) that looks at the origin: x right, y down, z forward."""
    away = np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])
    x = np.cross(-away, UP)
    x /= np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, np.cross(-away, x), -away])
    T[:3, 3] = distance * away
    return T


def frame(solids: Sequence[Solid], T: np.ndarray, rng: np.random.Generator, noise: float, table: bool) -> np.ndarray:
    """(H, W, 3) float32 in the camera's frame: depth with noise (m, at 0.6 m) and holes, NaN where nothing is met."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    own = np.stack([(u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL, np.ones_like(u)], axis=-1)
    rays = own @ T[:3, :3].T
    depth = np.full(u.shape, np.inf)
    if table:
        depth = np.where(rays[..., 2] < 0, -T[2, 3] / rays[..., 2], np.inf)
    for solid in solids:
        depth = np.minimum(depth, solid.hits(T[:3, 3], rays))
    depth = depth + rng.normal(size=depth.shape) * noise * (np.minimum(depth, 3.0) / 0.6) ** 2
    depth[(depth > 3.0) | (rng.random(depth.shape) < 0.01)] = np.nan
    return (own * depth[..., None]).astype(np.float32)


def jolted(T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A pose that is off by up to a centimetre and a few degrees."""
    rough = T.copy()
    rough[:3, :3] = turn_about_z(rng.uniform(-0.05, 0.05)) @ T[:3, :3]
    rough[:3, 3] += rng.uniform(-0.01, 0.01, 3)
    return rough


# ------------------------------------------------------------------------------------------------- clouds of objects


@dataclass(frozen=True)
class PlanCase:
    """A cloud to plan on, and what is known of its surroundings."""

    name: str
    points: np.ndarray
    surroundings: dict[str, np.ndarray]


def seen_of_mesh(mesh: Any, rng: np.random.Generator, count: int) -> np.ndarray:
    """(N, 3) points on those faces of a mesh that face a camera above it."""
    faces = rng.choice(len(mesh.faces), count, p=mesh.area_faces / mesh.area_faces.sum())
    a, b = rng.random((2, count, 1))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    corners = mesh.triangles[faces]
    points = corners[:, 0] + a * (corners[:, 1] - corners[:, 0]) + b * (corners[:, 2] - corners[:, 0])
    eye = np.array([0.3, 0.1, 0.5])
    return points[((eye - points) * mesh.face_normals[faces]).sum(axis=1) > 0]


def seen_of_solid(solid: Solid, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) what a camera above sees of a solid on the table, in the world's frame."""
    T = camera(float(rng.uniform(0, 6)), float(rng.uniform(0.6, 1.4)))
    points = frame([solid], T, rng, 0.0005, table=False).reshape(-1, 3).astype(np.float64)
    points = points[np.isfinite(points[:, 2])]
    return points @ T[:3, :3].T + T[:3, 3]


def plan_cases(catalogue: Any, count: int) -> Iterator[PlanCase]:
    """Objects of the catalogue and solids, by turns; every mixture of up, table, obstacles and another frame."""
    for number in range(count):
        rng = np.random.default_rng([number, 1])
        if number % 3 < 2:
            name = catalogue.classes[number % len(catalogue.classes)]
            model = catalogue.load(name, number % catalogue.instances_per_class)
            points = seen_of_mesh(model.visual_mesh(), rng, int(rng.integers(300, 5000)))
            points = points @ turn_about_z(rng.uniform(0, 6)).T
        else:
            (solid,) = solids_on_table(rng, 1)
            name, points = solid.kind, seen_of_solid(solid, rng)
        points += np.append(rng.uniform(-0.1, 0.1, 2), 0.004 - points[:, 2].min())
        yield PlanCase(f"{number:03d} {name}", *_placed(points, number, rng))


def _placed(points: np.ndarray, number: int, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The points and their surroundings, every fourth time in a frame of which z is not up."""
    turn = any_turn(rng) if number % 4 == 3 else np.eye(3)
    shift = np.array([0.0, 0.0, 0.6]) if number % 4 == 3 else np.zeros(3)
    up, known = turn @ UP, {}
    if number % 5 != 4:
        known["up"] = up
    if number % 2:
        known["table"] = np.append(up, -up @ shift)
    if number % 3 == 0:
        beside = points.mean(axis=0)
        beside[1] += np.ptp(points[:, 1]) / 2 + rng.uniform(0.03, 0.08)
        known["obstacles"] = (beside + rng.uniform(-0.03, 0.03, (300, 3))) @ turn.T + shift
    return points @ turn.T + shift, known
