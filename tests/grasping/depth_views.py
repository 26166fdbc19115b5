"""What a depth camera sees of simple things on a table: of their surfaces, drawn into an image, the nearest points."""

from __future__ import annotations

import numpy as np
from grasping_shapes import grid
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SIZE, FOCAL = 400, 500.0  # pixels


def wall(radius: float, low: float, high: float, step: float = 0.0008) -> FloatArray:
    """A standing tube."""
    turns = np.linspace(-np.pi, np.pi, int(2 * np.pi * radius / step))
    heights = np.arange(low, high + step / 2, step)
    angle, z = (values.reshape(-1) for values in np.meshgrid(turns, heights))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def disc(radius: float, height: float, step: float = 0.0008) -> FloatArray:
    flat = grid((-radius, radius), (-radius, radius), step=step)
    flat = flat[np.hypot(*flat.T) <= radius]
    return np.column_stack([flat, np.full(len(flat), height)])


def can(radius: float, height: float) -> FloatArray:
    return np.vstack([wall(radius, 0.0, height), disc(radius, height)])


def cup(radius: float, height: float, thick: float = 0.003) -> FloatArray:
    """Open above: an outer and an inner wall, a rim, a floor."""
    inner = radius - thick
    rim = disc(radius, height)
    rim = rim[np.hypot(rim[:, 0], rim[:, 1]) >= inner]
    return np.vstack([wall(radius, 0.0, height), wall(inner, thick, height), rim, disc(inner, thick)])


def brick(length: float, width: float, height: float, step: float = 0.0008) -> FloatArray:
    """All faces of a box on the table but the lower one, along x and y."""
    x, y = (-length / 2, length / 2), (-width / 2, width / 2)
    top, front, side = grid(x, y, step=step), grid(x, (0.0, height), step=step), grid(y, (0.0, height), step=step)
    faces = [np.column_stack([top, np.full(len(top), height)])]
    for sign in (-1, 1):
        faces.append(np.column_stack([front[:, 0], np.full(len(front), sign * width / 2), front[:, 1]]))
        faces.append(np.column_stack([np.full(len(side), sign * length / 2), side[:, 0], side[:, 1]]))
    return np.vstack(faces)


def camera_at(elevation: float, azimuth: float = -90.0, distance: float = 0.55, height: float = 0.05) -> FloatArray:
    """T_world_camera (4, 4) of a camera (OpenCV) that looks at a place above the world's origin; angles in degrees."""
    up, around = np.deg2rad([elevation, azimuth])
    away = np.array([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
    right = np.cross(-away, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([right, np.cross(-away, right), -away])
    T[:3, 3] = distance * away + [0.0, 0.0, height]
    return T


def seen_by(surface: FloatArray, T_world_camera: FloatArray) -> FloatArray:
    """Of a surface (N, 3) in the world the points that a camera sees, one a pixel, in the camera's frame."""
    own = (surface - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    pixel = np.floor(own[:, :2] / own[:, 2:] * FOCAL + SIZE / 2).astype(np.int64)
    key = pixel[:, 1] * SIZE + pixel[:, 0]
    order = np.argsort(own[:, 2], kind="stable")
    _, first = np.unique(key[order], return_index=True)
    return own[order[first]]


def table_in(T_world_camera: FloatArray) -> FloatArray:
    """The table's plane (4,) in the camera's frame."""
    return np.append(T_world_camera[2, :3], T_world_camera[2, 3])
